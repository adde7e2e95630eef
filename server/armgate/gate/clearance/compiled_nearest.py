"""Compiled form of the nearest pairs, for installations with numba (extra `fast`).

Kernels lower the margins, find the lowest ones, and prove the bound of a pair by the direction that coal
suggests. Everything else, such as overlapping bodies and the second engine, is done by the readable form.
"""

import numpy as np

from armgate.events import Joints
from armgate.gate.clearance.certificate import GAP, point
from armgate.gate.clearance.clearance import Clearance
from armgate.gate.clearance.compiled import CompiledPrefilter, kernels
from armgate.gate.clearance.engines import radii_of
from armgate.gate.clearance.nearest_pairs import NearestPairs, Points
from armgate.gate.clearance.prefilter import RobotPairs
from armgate.gate.clearance.swept import Array, Swept


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
        self._direction = np.zeros(3)

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

    def _refresh(self, robot: int, place: int) -> tuple[float, Points]:
        a, b, chained, swapped = self._pairs[robot][place]
        (R, t), certifier = self._poses, self._clearance.certifier
        found = certifier.first.query(a, (R[a], t[a]), b, (R[b], t[b]))
        lb, distance = kernels().certify(
            self._prefilter.cell, self._poses, (a, b, chained), found, self._radii, self._direction
        )
        if not (lb >= 0.0 and abs(distance - lb) <= GAP):
            return super()._refresh(robot, place)
        certifier.queries += 1
        pair = int(self._clearance.pairs_of[robot][place])
        self._clearance.keep_direction(pair, -self._direction if swapped else self._direction)
        mine, theirs = (point(x) for x in found[1:3])
        return lb, (theirs, mine) if swapped else (mine, theirs)

    def _lowest(self, robot: int, margin: Array) -> list[int]:
        return [k for k in kernels().lowest(margin, self._others[robot]) if k >= 0]

    def _first(self, margin: Array, count: int) -> list[int]:
        places = np.empty(count, np.intp)
        found: int = kernels().first(margin, places)
        return list(map(int, places[:found]))


def _bodies(own: RobotPairs) -> list[tuple[int, int, bool, bool]]:
    """Return for each pair its bodies, True if they are of one chain, and True if their order is reversed."""
    chained, reversed_ = np.arange(len(own.ids)) < own.chained, own.sign < 0
    columns = (own.mine, own.theirs, chained, reversed_)
    return list(zip(*(column.tolist() for column in columns), strict=True))
