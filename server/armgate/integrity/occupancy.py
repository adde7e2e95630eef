"""Occupancy: all positions that a robot may pass from now until it rests.

It is the convex hull of the measured q, the setpoints inside the declared lag window and the end of the
stop. A robot that lags its setpoint is *not* on the line from q to the setpoint, but it stays in this hull.
The hull is covered by the polyline measured – setpoint – end, each joint widened by a tube

    e_j = (history's largest deviation from the chord AB)_j + |A + l₁/(l₁+l₂)·(C − A) − B|_j + tolerance_j.

The second term covers the triangle ABC: a point of AC and the polyline's point at the same share of the way
differ most at the corner. A hull of points that each lie within e of the triangle lies within e of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from armgate.cell.events import Joints

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Occupancy:
    """A polyline of joint positions and the tube around it, rad or m per joint."""

    nodes: tuple[Joints, ...]
    tube: Joints

    @property
    def segments(self) -> list[tuple[Joints, Joints]]:
        """The polyline's segments; one of length zero for a robot that stands still."""
        return list(pairwise(self.nodes)) or [(self.nodes[0], self.nodes[0])]

    @property
    def end(self) -> Joints:
        """Where the robot rests if nothing else is admitted."""
        return self.nodes[-1]


def occupancy(
    measured: Joints, setpoint: Joints, end: Joints, history: Sequence[Joints], tolerance: float
) -> Occupancy:
    """Covers the hull of the measured position, the setpoints in the lag window and the end of the stop.

    Args:
        measured: A, the measured q.
        setpoint: B, the commanded position.
        end: C, the end of the stop.
        history: Setpoints inside the declared lag window.
        tolerance: Rounding of the measured q, rad or m.
    """
    cut = _corner_cut(measured, setpoint, end)
    lag = [0.0] * len(measured)
    for past in history:
        near = _nearest(past, measured, setpoint)
        lag = [max(e, abs(p - x)) for e, p, x in zip(lag, past, near, strict=True)]
    tube = tuple(a + b + tolerance for a, b in zip(cut, lag, strict=True))
    return Occupancy(_without_repeats((measured, setpoint, end)), tube)


def settle_measured(q: Joints, held: Sequence[Occupancy], tolerance: float) -> Joints | None:
    """Returns the measured position to go on with, None if no held occupancy explains it.

    A measurement off the proven cover by no more than its own rounding is taken at the cover's edge, so that
    rounding never makes an occupancy grow.
    """
    for one in held:
        exact = tuple(e - tolerance + _ROUNDING for e in one.tube)
        if _share_within(q, one, exact) is not None:
            return q
    for one in held:
        at = _share_within(q, one, tuple(e + _ROUNDING for e in one.tube))
        if at is not None:
            slack = [e - tolerance for e in one.tube]
            return tuple(min(max(x, c - w), c + w) for x, c, w in zip(q, at, slack, strict=True))
    return None


def deviation(q: Joints, one: Occupancy) -> float:
    """Returns how far, in its worst joint, ``q`` is from the nearest point of the polyline, rad or m."""
    near = [_nearest(q, a, b) for a, b in one.segments]
    return min(max(abs(x - y) for x, y in zip(q, p, strict=True)) for p in near)


def _without_repeats(nodes: tuple[Joints, ...]) -> tuple[Joints, ...]:
    return nodes[:1] + tuple(b for a, b in pairwise(nodes) if a != b)


def _length(a: Joints, b: Joints) -> float:
    return math.sqrt(sum((y - x) ** 2 for x, y in zip(a, b, strict=True)))


def _corner_cut(a: Joints, b: Joints, c: Joints) -> list[float]:
    first, second = _length(a, b), _length(b, c)
    if first == 0.0 or second == 0.0:
        return [0.0] * len(a)
    share = first / (first + second)
    return [abs(x + share * (z - x) - y) for x, y, z in zip(a, b, c, strict=True)]


def _nearest(q: Joints, a: Joints, b: Joints) -> Joints:
    along = [y - x for x, y in zip(a, b, strict=True)]
    square = sum(d * d for d in along)
    if square == 0.0:
        return a
    share = sum((x - p) * d for x, p, d in zip(q, a, along, strict=True)) / square
    share = min(max(share, 0.0), 1.0)
    return tuple(p + share * d for p, d in zip(a, along, strict=True))


def _share_within(q: Joints, one: Occupancy, width: Joints) -> Joints | None:
    """Returns a point of the polyline within ``width`` of ``q`` in every joint, None if there is none."""
    for a, b in one.segments:
        low, high = 0.0, 1.0
        for x, p, r, w in zip(q, a, b, width, strict=True):
            d = r - p
            if abs(d) < _ROUNDING:
                low, high = (low, high) if abs(x - p) <= w + abs(d) else (1.0, 0.0)
                continue
            s, t = (x - p - w) / d, (x - p + w) / d
            low, high = max(low, min(s, t)), min(high, max(s, t))
        if low <= high:
            middle = 0.5 * (low + high)
            return tuple(p + middle * (r - p) for p, r in zip(a, b, strict=True))
    return None
