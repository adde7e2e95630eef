"""The nearest pairs at the measured positions, for the state: told as lower bounds, the nearest one tight.

A lower bound is kept for every pair and lowered by what its robots moved since. The lowest bounds are asked
again of
the engine until the lowest is a fresh one: then no pair can be nearer than it says. So only near pairs cost
    anything.
"""

from collections.abc import Sequence

import numpy as np

from armgate.cell.cell import Cell
from armgate.cell.events import Joints, Nearest
from armgate.integrity.certificate import Proof
from armgate.integrity.clearance import Clearance, ordered
from armgate.integrity.groups import Group
from armgate.integrity.swept import Index, Swept

_FEW = 4
_REFRESHES = 64


class NearestPairs:
    """Finds the nearest pairs of one robot at a time; keeps the directions that it finds."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        pairs = clearance.cell.pairs
        self._others = tuple(
            np.array([p for p in ids if pairs[p].kind != "self"], dtype=np.intp) for ids in clearance.pairs_of
        )
        self._margin = np.full(len(pairs), np.inf)
        self._last: list[Joints | None] = [None] * len(clearance.cell.robots)

    def find(self, robot: int, measured: Sequence[Joints | None], count: int) -> dict[int, Nearest]:
        """Returns the ``count`` nearest pairs by index, by margin; the nearest (and nearest other) tight.

        Args:
            robot: Whose pairs.
            measured: The measured q of every robot, None where it is not known.
            count: How many.
        """
        c, ids = self._clearance, self._clearance.pairs_of[robot]
        for i, q in enumerate(measured):
            self._follow(i, q, measured)
        proofs: dict[int, Proof] = {}
        for asked in range(_REFRESHES):
            stale = [p for p in self._lowest(robot) if p not in proofs]
            if not stale:
                break
            if asked == _FEW:  # many moved far: one slab for all is cheaper than the engine for each
                self._measure(robot, measured)
                continue
            proofs[stale[0]] = proof = self._refresh(robot, stale[0], measured)
            self._margin[stale[0]] = proof.lb - c.limits[stale[0]]
        order = ids[np.argsort(self._margin[ids], kind="stable")]
        wanted = [int(p) for p in order[:count]]
        wanted += [p for p in self._lowest(robot) if p not in wanted]
        return {p: self._told(robot, p, proofs.get(p)) for p in wanted if np.isfinite(self._margin[p])}

    def _follow(self, robot: int, q: Joints | None, measured: Sequence[Joints | None]) -> None:
        """Lowers the bounds of a robot's pairs by what it moved; finds them where it is seen first."""
        last, self._last[robot] = self._last[robot], q
        if q is None or q == last:
            return
        ids = self._clearance.pairs_of[robot]
        if last is not None:
            self._margin[ids] -= self._clearance.growth(robot, np.abs(np.subtract(q, last)))
            return
        self._measure(robot, measured)

    def _measure(self, robot: int, measured: Sequence[Joints | None]) -> None:
        """Proves what the kept directions prove of all of a robot's pairs at the measured positions."""
        q = measured[robot]
        for group in self._clearance.groups[robot]:
            side = self._side(group, measured)
            if q is None or side is None:
                continue
            every: Index = np.arange(len(group.ids))
            mine = self._clearance.space.still(robot, q)
            lb, _, _ = group.slab(mine, side, every, self._clearance.kept_n(group, every))
            known = np.isfinite(self._margin[group.ids])
            kept = np.where(known, self._margin[group.ids], -np.inf)
            self._margin[group.ids] = np.maximum(kept, lb - group.limit)

    def _refresh(self, robot: int, pair: int, measured: Sequence[Joints | None]) -> Proof:
        group, k = self._clearance.find(robot, pair)
        mine, side = measured[robot], self._side(group, measured)
        assert mine is not None  # its margin is known, so both positions are
        assert side is not None
        proof = self._clearance.certifier.prove(
            group, k, self._clearance.space.still(robot, mine), side, (0, 0)
        )
        self._clearance.keep_n(group, k, proof.n)
        return proof

    def _lowest(self, robot: int) -> list[int]:
        """The pair with the lowest bound of all, and of those with others; none of unknown robots."""
        every, others = self._clearance.pairs_of[robot], self._others[robot]
        lowest = [int(ids[np.argmin(self._margin[ids])]) for ids in (every, others) if len(ids)]
        return [pair for pair in lowest if np.isfinite(self._margin[pair])]

    def _side(self, group: Group, measured: Sequence[Joints | None]) -> Swept | None:
        if group.other is None:
            return self._clearance.space.static
        q = measured[group.other]
        return None if q is None else self._clearance.space.still(group.other, q)

    def _told(self, robot: int, pair: int, proof: Proof | None) -> Nearest:
        c = self._clearance
        limit = float(c.limits[pair])
        points = None if proof is None else ordered(*c.find(robot, pair), proof.points)
        return Nearest(c.names(pair), float(self._margin[pair] + limit), limit, points)


def start_clearances(cell: Cell) -> list[Nearest]:
    """Returns the clearances at the start positions, nearest first: the nearest pairs of each robot."""
    clearance = Clearance(cell, compiled=False)  # asked once: not worth loading a compiler
    start = [tuple(float(x) for x in r.start) for r in cell.robots]
    for i, q in enumerate(start):
        clearance.hold(i, [clearance.space.still(i, q)])
    for i in range(len(start)):
        clearance.survey(i)
    nearest = NearestPairs(clearance)
    found: dict[int, Nearest] = {}
    for i in range(len(start)):
        found |= nearest.find(i, start, _REFRESHES)
    return sorted(found.values(), key=lambda n: n.distance - n.limit)
