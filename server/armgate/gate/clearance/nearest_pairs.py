"""Nearest pairs at the measured positions, for the state: lower bounds, of which the lowest is tight.

A lower bound is kept for every pair and lowered by the motion of its robots. The pairs with the lowest bounds
are measured until the lowest bound is a measured one: then no pair can be nearer than that. So only near
pairs need to be measured.

A measurement needs a direction and witness points. Those of the last engine query of the pair, moved with
their bodies, often suffice: |q − p| is at least the distance, and the slab along q − p is at most the
distance. If the two differ by at most ``certificate.TIGHT``, the engine is not queried.

`armgate.gate.clearance.compiled_nearest` has the compiled form.
"""

from bisect import insort
from collections.abc import Iterable, Sequence
from math import isfinite

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import Joints, Nearest, Point
from armgate.gate.clearance.clearance import Clearance
from armgate.gate.clearance.pair_check import in_pair_order
from armgate.gate.clearance.pair_groups import Group
from armgate.gate.clearance.swept import Array, Index, Swept

Points = tuple[Point, Point]
"""Witness points of a pair, world frame, m."""

FEW = 4
MANY = 64
REFRESHES = 64


class NearestPairs:
    """Search for the nearest pairs of a robot; keeps the directions that it finds."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        pairs = clearance.cell.pairs
        # Places of the pairs with other robots or surroundings among a robot's pairs.
        self._others = [np.flatnonzero([pairs[p].kind != "self" for p in ids]) for ids in clearance.pairs_of]
        self._margin = np.full(len(pairs), np.inf)
        # Witness points of the last measurement of each pair, each in the frame of its body; NaN for none.
        self._witnesses = np.full((len(pairs), 2, 3), np.nan)
        self._last: list[Joints | None] = [None] * len(clearance.cell.robots)
        self._motion: list[Array | None] = [None] * len(clearance.cell.robots)
        self._still: list[Swept | None] = [None] * len(clearance.cell.robots)
        self._names = [clearance.names(k) for k in range(len(pairs))]
        self._limits: list[float] = clearance.limits.tolist()

    def find(self, robot: int, measured: Sequence[Joints | None], count: int) -> dict[int, Nearest]:
        """Return the ``count`` nearest pairs, by index, in the order of their margins.

        The nearest pair, and the nearest with another robot or the surroundings, are tight.

        Args:
            robot: Index of the robot.
            measured: The measured q of every robot, None if it is not known.
            count: Number of pairs.
        """
        for i, q in enumerate(measured):
            self._follow(i, q)
        shown = self._search(robot, count)
        return {pair: self._entry(pair, margin, points) for pair, margin, points in shown}

    def _search(self, robot: int, count: int) -> Iterable[tuple[int, float, Points | None]]:
        """Return the pairs to report with their margins, and witness points if they were measured."""
        ids = self._clearance.pairs_of[robot]
        margin = self._margin.take(ids)
        points = self._tighten(robot, margin)
        self._margin[ids] = margin
        shown = self._shown(robot, margin, count)
        return zip(ids[shown].tolist(), margin[shown].tolist(), map(points.get, shown), strict=True)

    def _tighten(self, robot: int, margin: Array) -> dict[int, Points]:
        """Measure pairs until the lowest margins are measured ones; return the witness points by place."""
        limits, points = self._clearance.limits_of[robot], dict[int, Points]()
        queries = 0
        while stale := [k for k in self._lowest(robot, margin) if k not in points]:
            measured = self._recall(robot, stale[0])
            if measured is None:
                queries += 1
                if queries > REFRESHES:
                    break
                if queries % FEW == 0:  # many bounds are low: one slab for all is cheaper than more queries
                    self._measure(robot, first(margin, MANY), margin)
                    continue
                measured = self._refresh(robot, stale[0])
            lb, points[stale[0]] = measured
            margin[stale[0]] = lb - limits[stale[0]]
        return points

    def exact(self, robot: int, measured: Sequence[Joints], count: int) -> dict[int, Nearest]:
        """Return, by index, the ``count`` nearest pairs and all below their limits, all of them tight."""
        for i, q in enumerate(measured):
            self._follow(i, q)
        ids, limits = self._clearance.pairs_of[robot], self._clearance.limits_of[robot]
        left, tight = self._margin.take(ids), [np.inf] * count
        found: dict[int, Nearest] = {}
        while len(found) < len(ids):
            k = int(left.argmin())
            if left[k] >= max(0.0, tight[count - 1]):
                break  # the pairs left cannot be nearer than their bounds
            lb, points = self._refresh(robot, k)
            margin = float(lb - limits[k])
            self._margin[ids[k]] = margin
            found[int(ids[k])] = self._entry(int(ids[k]), margin, points)
            insort(tight, margin)
            left[k] = np.inf
        return found

    def _follow(self, robot: int, q: Joints | None) -> None:
        """Lower the bounds of a robot's pairs by its motion since the last call.

        They are computed anew when its position becomes known, and when its motion bounds have changed.
        """
        last, self._last[robot] = self._last[robot], q
        if q is None or q == last:
            return
        motion, before = self._clearance.space.motion[robot], self._motion[robot]
        if motion is not before:
            last, self._motion[robot] = None, motion
        self._move(robot, q, last)
        if last is None:
            ids = self._clearance.pairs_of[robot]
            margin = np.full(len(ids), np.inf)
            self._measure(robot, np.arange(len(ids)), margin)
            self._margin[ids] = margin

    def _move(self, robot: int, q: Joints, last: Joints | None) -> None:
        """Place a robot's bodies at ``q``; lower the bounds of its pairs by the motion from ``last``, if any.

        The compiled form is ``kernels.follow``.
        """
        self._still[robot] = self._clearance.space.still(robot, q)
        if last is not None:
            ids = self._clearance.pairs_of[robot]
            self._margin[ids] -= self._clearance.growth(robot, np.abs(np.subtract(q, last)))

    def _measure(self, robot: int, places: Index, margin: Array) -> None:
        """Raise some of a robot's margins to the bounds by the kept directions at the measured positions."""
        mine, first = self._placed(robot), 0
        for group in self._clearance.groups[robot]:
            here, first = (
                places[(places >= first) & (places < first + len(group.ids))],
                first + len(group.ids),
            )
            side = self._side(group)
            if mine is None or side is None or not len(here):
                continue
            sel: Index = here + len(group.ids) - first
            lb, _, _ = group.slab(mine, side, sel, self._clearance.kept_n(group, sel))
            kept = np.where(np.isfinite(margin[here]), margin[here], -np.inf)
            margin[here] = np.maximum(kept, lb - group.limit[sel])

    def _recall(self, robot: int, place: int) -> tuple[float, Points] | None:
        """Measure one of a robot's pairs by its kept witness points, and keep the direction.

        Returns:
            As `_refresh`; None if the points do not suffice.

        The compiled form is ``kernels.recall``.
        """
        pair = int(self._clearance.pairs_of[robot][place])
        group, k, mine, side = self._sides(robot, pair)
        kept = self._witnesses[pair][:: int(group.sign[k])]
        certificate = self._clearance.certifier.recall(group, k, mine, side, kept)
        if certificate is None:
            return None
        self._clearance.keep_n(group, k, certificate.n)
        points = in_pair_order(group, k, certificate.points)
        assert points is not None
        return certificate.lb, points

    def _refresh(self, robot: int, place: int) -> tuple[float, Points]:
        """Query the engine for one of a robot's pairs; keep the direction and the witness points.

        Returns:
            The bound, and the witness points in the order of the pair's bodies.
        """
        pair = int(self._clearance.pairs_of[robot][place])
        group, k, mine, side = self._sides(robot, pair)
        certificate = self._clearance.certifier.prove(group, k, mine, side, (0, 0))
        self._clearance.keep_n(group, k, certificate.n)
        points = in_pair_order(group, k, certificate.points)
        assert points is not None
        bodies = mine.pose(0, int(group.mine[k])), side.pose(0, int(group.theirs[k]))
        local = [(np.array(p) - t) @ R for p, (R, t) in zip(certificate.points, bodies, strict=True)]
        self._witnesses[pair] = local[:: int(group.sign[k])]
        return certificate.lb, points

    def _sides(self, robot: int, pair: int) -> tuple[Group, int, Swept, Swept]:
        """Return the group of one of a robot's pairs, its place there, and both sides at the measured q."""
        group, k = self._clearance.find(robot, pair)
        mine, side = self._placed(robot), self._side(group)
        assert mine is not None  # its margin is known, so both positions are known
        assert side is not None
        return group, k, mine, side

    def _lowest(self, robot: int, margin: Array) -> list[int]:
        """Return the places of the lowest known margins.

        The first is that of all pairs; the second is that of pairs with another robot or the surroundings.
        The compiled form is in ``kernels.stale``.
        """
        lowest = [int(margin.argmin())] if len(margin) else []
        others = self._others[robot]
        if len(others):
            lowest.append(int(others[margin.take(others).argmin()]))
        return [k for k in lowest if isfinite(margin[k])]

    def _placed(self, robot: int) -> Swept | None:
        """Return a robot's bodies at its measured position; None if that is not known."""
        return self._still[robot]

    def _side(self, group: Group) -> Swept | None:
        return self._clearance.space.static if group.other is None else self._placed(group.other)

    def _shown(self, robot: int, margin: Array, count: int) -> list[int]:
        """Return the places of the ``count`` lowest known margins, the lowest first, and of `_lowest`.

        The compiled form is in ``kernels.end``.
        """
        finite = [int(k) for k in first(margin, count) if isfinite(margin[k])]
        return list(dict.fromkeys([*finite, *self._lowest(robot, margin)]))

    def _entry(self, pair: int, margin: float, points: Points | None) -> Nearest:
        limit = self._limits[pair]
        return Nearest(self._names[pair], margin + limit, limit, points)


def first(margin: Array, count: int) -> Index:
    """Return the places of the ``count`` lowest margins, the lowest first; of equal ones, the first."""
    if count < len(margin):
        lowest = np.sort(np.argpartition(margin, count - 1)[:count])
    else:
        lowest = np.arange(len(margin))
    return np.asarray(lowest[np.argsort(margin[lowest], kind="stable")])


def start_clearances(cell: Cell, count: int = 16) -> list[Nearest]:
    """Return the pairs below their limits and the nearest pairs at the start positions, sorted by margin.

    Their distances are tight bounds, without the motion that occupancies allow.

    Args:
        cell: The cell.
        count: Least number of pairs of each robot.
    """
    clearance = Clearance(cell, compiled=False)  # used once: not worth loading a compiler
    start = [tuple(float(x) for x in r.start) for r in cell.robots]
    for i, q in enumerate(start):
        clearance.hold(i, [clearance.space.still(i, q)])
    for i in range(len(start)):
        clearance.prove_all(i)
    nearest = NearestPairs(clearance)
    found: dict[int, Nearest] = {}
    for i in range(len(start)):
        found |= nearest.exact(i, start, count)
    return sorted(found.values(), key=lambda n: n.distance - n.limit)
