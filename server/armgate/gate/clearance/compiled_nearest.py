"""Compiled form of the nearest pairs, for installations with numba (extra `fast`).

Kernels lower the margins, find the lowest ones, and prove the bound of a pair by its witness points or by the
direction that coal suggests. Everything else, such as overlapping bodies and the second engine, is done by
the readable form.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.events import Joints
from armgate.gate.clearance.clearance import Clearance
from armgate.gate.clearance.compiled import CompiledPrefilter, Records, kernels
from armgate.gate.clearance.engines import radii_of
from armgate.gate.clearance.nearest_pairs import FEW, MANY, REFRESHES, NearestPairs, Points, first
from armgate.gate.clearance.prefilter import RobotPairs
from armgate.gate.clearance.swept import Array, Index, Swept


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
        self._own = [_numbers(own, prefilter.own[i][0]) for i, own in enumerate(prefilter.pairs)]
        self._bodies = [
            list(zip(own.mine.tolist(), own.theirs.tolist(), strict=True)) for own in prefilter.pairs
        ]
        self._ids: list[list[int]] = [ids.tolist() for ids in clearance.pairs_of]
        # Placements of all bodies of the cell at the measured positions.
        self._poses = static.R[0].copy(), static.t[0].copy()
        self._q = [np.zeros(robot.model.n) for robot in cell.robots]
        self._views = list(zip(*self._poses, strict=True))
        # Margins of each robot's pairs during a search, and marks of those that were measured; limits.
        self._searches = [
            (np.empty(len(limits)), np.zeros(len(limits), np.bool_), limits, others)
            for limits, others in zip(clearance.limits_of, self._others, strict=True)
        ]

        self._result = _result(0)

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
        arguments = self._arguments(robot, count)
        margin = self._searches[robot][0]
        place, number = kernels().begin(*arguments)
        for query in range(1, REFRESHES + 1):
            if place < 0:
                break
            if query % FEW == 0:
                self._measure(robot, first(margin, MANY), margin)
                place, number = kernels().recall(*arguments)
            else:
                place, number = self._certify(robot, place, arguments)
        if place >= 0:
            number = kernels().end(*arguments)
        places, margins, measured, points = [column[:number].tolist() for column in self._result]
        ids, rows = self._ids[robot], zip(places, margins, measured, points, strict=True)
        return [(ids[at], low, _as_points(p) if tight else None) for at, low, tight, p in rows]

    def _arguments(self, robot: int, count: int) -> tuple[Any, ...]:
        """Return the first arguments of the kernels for a search; the last one receives its result."""
        if len(self._result[0]) != count + 2:
            self._result = _result(count + 2)
        kept, found = (self._clearance.directions, self._witnesses), (self._margin, *self._result)
        scene = self._prefilter.cell, self._poses
        return scene, self._own[robot], kept, self._searches[robot], found

    def _certify(self, robot: int, place: int, arguments: tuple[Any, ...]) -> tuple[int, int]:
        """Measure a pair's margin by a query; return the results of ``kernels.recall``."""
        (a, b), views, certifier = self._bodies[robot][place], self._views, self._clearance.certifier
        found = certifier.first.query(a, views[a], b, views[b])
        accepted, following, number = kernels().certify(*arguments, (place, self._radii, *found))
        if accepted:
            certifier.queries += 1
            return following, number
        lb, _ = self._refresh(robot, place)
        margin, tight, limits, _ = self._searches[robot]
        margin[place], tight[place] = lb - limits[place], True
        following, number = kernels().recall(*arguments)
        return following, number

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: a pickled view would no longer share its memory."""
        self.__dict__.update(state)
        self._views = list(zip(*self._poses, strict=True))


def _numbers(own: RobotPairs, pairs: Records) -> tuple[Records, Index, Array, int]:
    """Return a robot's pairs in the kernels' form: bodies, ids, signs, number of those of one chain."""
    return pairs, own.ids, own.sign, own.chained


def _result(size: int) -> tuple[Index, Array, NDArray[np.bool_], Array]:
    """Return arrays for places, margins, marks of those that were measured, and witness points."""
    return np.empty(size, np.intp), np.empty(size), np.empty(size, np.bool_), np.empty((size, 6))


def _as_points(row: list[float]) -> Points:
    a, b, c, d, e, f = row
    return (a, b, c), (d, e, f)
