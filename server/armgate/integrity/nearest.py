"""The nearest pairs at the measured positions, for the state: told as lower bounds, the nearest one tight.

A kept direction proves little for a pair that turned since it was found. So the lowest bounds are asked
again of the engine until the lowest is a fresh one: then no pair can be nearer than it says.
"""

from collections.abc import Sequence

import numpy as np

from armgate.cell.cell import Cell
from armgate.cell.events import Joints, Nearest
from armgate.integrity.certificate import Proof
from armgate.integrity.clearance import Clearance, ordered
from armgate.integrity.groups import Group
from armgate.integrity.swept import Array, Index, Swept

_REFRESHES = 16


class NearestPairs:
    """Finds the nearest pairs of one robot at a time; keeps the directions that it finds."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        pairs = clearance.cell.pairs
        self._others = tuple(
            np.array([p for p in ids if pairs[p].kind != "self"], dtype=np.intp) for ids in clearance.pairs_of
        )

    def find(self, robot: int, measured: Sequence[Joints | None], count: int) -> dict[int, Nearest]:
        """Returns the ``count`` nearest pairs by index, by margin; the nearest (and nearest other) tight.

        Args:
            robot: Whose pairs.
            measured: The measured q of every robot, None where it is not known.
            count: How many.
        """
        c = self._clearance
        still = {i: c.space.still(i, q) for i, q in enumerate(measured) if q is not None}
        margin = self._margins(robot, still)
        proofs: dict[int, Proof] = {}
        for _ in range(_REFRESHES):
            stale = [p for p in self._lowest(robot, margin) if p not in proofs]
            if not stale:
                break
            proofs[stale[0]] = proof = self._refresh(robot, stale[0], still)
            margin[stale[0]] = proof.lb - c.limits[stale[0]]
        ids = c.pairs_of[robot][np.argsort(margin[c.pairs_of[robot]], kind="stable")]
        wanted = [int(p) for p in ids[:count]]
        wanted += [p for p in self._lowest(robot, margin) if p not in wanted]
        return {p: self._told(robot, p, margin[p], proofs.get(p)) for p in wanted if np.isfinite(margin[p])}

    def _margins(self, robot: int, still: dict[int, Swept]) -> Array:
        c = self._clearance
        margin = np.full(len(c.limits), np.inf)
        for group in c.groups[robot]:
            side = self._side(group, still)
            if side is not None:
                every: Index = np.arange(len(group.ids))
                lb, _, _ = group.slab(still[robot], side, every, c.kept_n(group, every))
                margin[group.ids] = lb - group.limit
        return margin

    def _refresh(self, robot: int, pair: int, still: dict[int, Swept]) -> Proof:
        group, k = self._clearance.find(robot, pair)
        side = self._side(group, still)
        assert side is not None  # its margin is known, so its other side is
        proof = self._clearance.certifier.prove(group, k, still[robot], side, (0, 0))
        self._clearance.keep_n(group, k, proof.n)
        return proof

    def _lowest(self, robot: int, margin: Array) -> list[int]:
        every, others = self._clearance.pairs_of[robot], self._others[robot]
        return [int(ids[np.argmin(margin[ids])]) for ids in (every, others) if len(ids)]

    def _side(self, group: Group, still: dict[int, Swept]) -> Swept | None:
        return self._clearance.space.static if group.other is None else still.get(group.other)

    def _told(self, robot: int, pair: int, margin: float, proof: Proof | None) -> Nearest:
        c = self._clearance
        limit = float(c.limits[pair])
        points = None if proof is None else ordered(*c.find(robot, pair), proof.points)
        return Nearest(c.names(pair), float(margin + limit), limit, points)


def start_clearances(cell: Cell) -> list[Nearest]:
    """Returns the clearances at the start positions, nearest first: the nearest pairs of each robot."""
    clearance = Clearance(cell)
    start = [tuple(float(x) for x in r.start) for r in cell.robots]
    for i, q in enumerate(start):
        clearance.hold(i, [clearance.space.still(i, q)])
    found: dict[int, Nearest] = {}
    nearest = NearestPairs(clearance)
    for i in range(len(start)):
        clearance.survey(i)
        found |= nearest.find(i, start, _REFRESHES)
    return sorted(found.values(), key=lambda n: n.distance - n.limit)
