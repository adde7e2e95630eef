"""Compiled form of the nearest pairs, for installations with numba (extra `fast`).

Kernels lower the margins, find the lowest ones, and prove the bound of a pair by the direction that coal
suggests. Everything else, such as overlapping bodies and the second engine, is done by the readable form.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from armgate.events import Joints
from armgate.gate.clearance.certificate import point
from armgate.gate.clearance.clearance import Clearance
from armgate.gate.clearance.compiled import CompiledPrefilter, kernels
from armgate.gate.clearance.engines import radii_of
from armgate.gate.clearance.nearest_pairs import FEW, MANY, REFRESHES, NearestPairs, Points, first
from armgate.gate.clearance.prefilter import RobotPairs
from armgate.gate.clearance.swept import Swept


def nearest_pairs_of(clearance: Clearance) -> NearestPairs:
    """Return the search for the nearest pairs, in the form of the clearance."""
    if isinstance(clearance.prefilter, CompiledPrefilter):
        return CompiledNearestPairs(clearance, clearance.prefilter)
    return NearestPairs(clearance)


class CompiledNearestPairs(NearestPairs):
    """`NearestPairs` with compiled bounds and certificates."""

    def __init__(self, clearance: Clearance, prefilter: CompiledPrefilter) -> None:
        super().__init__(clearance)
        self._prefilter = prefilter
        cell, static = clearance.cell, clearance.space.static
        self._radii = np.array(radii_of([body.shape for body in cell.bodies]))
        self._pairs = [_bodies(own) for own in prefilter.pairs]
        # Placements of all bodies of the cell at the measured positions.
        self._poses = static.R[0].copy(), static.t[0].copy()
        self._q = [np.zeros(robot.model.n) for robot in cell.robots]
        self._views = list(zip(*self._poses, strict=True))
        sizes = [len(ids) for ids in clearance.pairs_of]
        self._searches = [(np.empty(size), np.zeros(size, np.bool_)) for size in sizes]
        """Margins of each robot's pairs during a search, and marks of those that were measured."""

    def _move(self, robot: int, q: Joints, last: Joints | None) -> None:
        now = np.array(q)
        before, self._q[robot] = now if last is None else self._q[robot], now
        pairs = self._clearance.pairs_of[robot], self._prefilter.own[robot][1]
        kernels().follow(self._prefilter.cell, robot, (now, before), pairs, self._margin, self._poses)

    def _placed(self, robot: int) -> Swept | None:
        if self._last[robot] is None:
            return None
        q, space = self._q[robot], self._clearance.space
        return space.sweep_nodes(robot, q[None, :], np.zeros(len(q)))

    def _search(self, robot: int, count: int) -> Iterable[tuple[int, float, Points | None]]:
        ids, others, k = self._clearance.pairs_of[robot], self._others[robot], kernels()
        margin, tight = self._searches[robot]
        points: dict[int, Points] = {}
        place = k.begin(self._margin, ids, others, (margin, tight))
        for query in range(1, REFRESHES + 1):
            if place < 0:
                break
            if query % FEW == 0:
                self._measure(robot, first(margin, MANY), margin)
                place = k.stale(margin, others, tight)
            else:
                points[place], place = self._certify(robot, place)
        places = np.empty(count + 2, np.intp)
        found = k.end(self._margin, ids, others, margin, count, places)
        shown = places[:found].tolist()
        return [(self._pairs[robot][at][0], float(margin[at]), points.get(at)) for at in shown]

    def _certify(self, robot: int, place: int) -> tuple[Points, int]:
        """Measure a pair's margin; return its witness points, and the next place to measure, −1 for none."""
        pair, bodies = self._pairs[robot][place]
        a, b, _, reversed_ = bodies
        certifier, views, limits = self._clearance.certifier, self._views, self._clearance.limits_of[robot]
        margin, tight = self._searches[robot]
        found = certifier.first.query(a, views[a], b, views[b])
        search = margin, tight, limits, self._others[robot], place
        kept, posed = self._clearance.directions[pair], (*self._poses, self._radii)
        accepted, following = kernels().certify(self._prefilter.cell, posed, bodies, found, kept, search)
        if accepted:
            certifier.queries += 1
            p, q = point(found[1]), point(found[2])
            return ((q, p) if reversed_ else (p, q)), following
        lb, points = self._refresh(robot, place)
        margin[place], tight[place] = lb - limits[place], True
        return points, kernels().stale(margin, self._others[robot], tight)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: a pickled view would no longer share its memory."""
        self.__dict__.update(state)
        self._views = list(zip(*self._poses, strict=True))


def _bodies(own: RobotPairs) -> list[tuple[int, tuple[int, int, bool, bool]]]:
    """Return each pair: its index, its bodies, True for one chain, and True if the bodies are reversed."""
    chained, reversed_ = np.arange(len(own.ids)) < own.chained, own.sign < 0
    columns = (own.mine, own.theirs, chained, reversed_)
    bodies = zip(*(column.tolist() for column in columns), strict=True)
    return list(zip(own.ids.tolist(), bodies, strict=True))
