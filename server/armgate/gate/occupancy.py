"""Occupancy: the set of positions that a robot can still reach before it comes to rest.

It is the convex hull of the measured q, the setpoints inside the declared lag window and the end of the
stop. A robot that lags its setpoint is *not* on the line from q to the setpoint, but it stays in this hull.
The hull is covered by the polyline measured – setpoint – end, each joint widened by a tube

    e_j = (history's largest deviation from the chord AB)_j + |A + l₁/(l₁+l₂)·(C − A) − B|_j + tolerance_j
          + (distance by which axes that lag differently may leave the hull)_j.

The second term covers the triangle ABC: a point of AC and the polyline's point at the same share of the way
differ most at the corner. A hull of points that each lie within e of the triangle lies within e of it.
"""

import math
from collections.abc import Sequence
from itertools import pairwise, repeat
from operator import add, sub
from typing import TYPE_CHECKING, NamedTuple

from armgate.events import Joints
from armgate.gate.tracking_lag import larger

if TYPE_CHECKING:
    from armgate.gate.robot import RobotState

_ROUNDING = 1e-9


class Occupancy(NamedTuple):
    """A polyline of joint positions and the tube around it, rad or m per joint.

    Attributes:
        nodes: The polyline.
        tube: Radius of the tube, per joint.
        lag_tube: Part of it for axes that lag differently, see `armgate.gate.tracking_lag`; () for none.
        between: Part of the lag tube that counts between the ticks only.
    """

    nodes: tuple[Joints, ...]
    tube: Joints
    lag_tube: Joints = ()
    between: Joints = ()

    @property
    def segments(self) -> list[tuple[Joints, Joints]]:
        """Segments of the polyline; one of length zero for a robot that stands still."""
        return list(pairwise(self.nodes)) or [(self.nodes[0], self.nodes[0])]

    @property
    def end(self) -> Joints:
        """Position at which the robot comes to rest if nothing else is admitted."""
        return self.nodes[-1]


def occupancy(
    measured: Joints,
    setpoint: Joints,
    end: Joints,
    history: Sequence[Joints],
    tolerance: float,
    lag_tube: tuple[Joints, Joints] = ((), ()),
) -> Occupancy:
    """Cover the hull of the measured position, the setpoints in the lag window and the end of the stop.

    Args:
        measured: A, the measured q.
        setpoint: B, the commanded position.
        end: C, the end of the stop.
        history: Setpoints inside the declared lag window.
        tolerance: Rounding of the measured q, rad or m.
        lag_tube: Distance by which axes that lag differently may leave the hull, per joint, and the part of
            it that counts between the ticks only; () if they lag alike.
    """
    cut = _corner_cut(measured, setpoint, end)
    if history:
        cut = list(map(add, cut, _largest_deviation(history, measured, setpoint)))
    tube = tuple([e + tolerance for e in cut])
    if lag_tube[0]:
        tube = tuple(map(add, tube, lag_tube[0]))
    return Occupancy(_without_repeats((measured, setpoint, end)), tube, *lag_tube)


def occupancy_to(state: "RobotState", end: Joints, increment: Joints) -> Occupancy:
    """Return the occupancy of a robot from the measured q over the setpoint to ``end``.

    Args:
        state: State of the robot.
        end: The end of the stop.
        increment: The first of the increments that lead there: no joint has a larger one after it.
    """
    return _cover(state, state.setpoint, end, [q for _, q in state.history], increment)


def occupancy_at(state: "RobotState", setpoint: Joints) -> Occupancy:
    """Return the occupancy of a robot after a rebase to ``setpoint``, until the link has it."""
    past = [*(q for _, q in state.history), state.setpoint]
    step = tuple([y - x for x, y in zip(state.setpoint, setpoint, strict=True)])
    return _cover(state, setpoint, setpoint, past, step)


def _cover(
    state: "RobotState", setpoint: Joints, end: Joints, past: list[Joints], increment: Joints
) -> Occupancy:
    first, tolerance = state.q, state.robot.q_tolerance + state.off_path
    if past and first == setpoint:  # a path from the farthest setpoint of the past is a tighter cover
        first = max(past, key=lambda q: math.dist(q, setpoint))
    if state.hull_deviation is None:
        return occupancy(first, setpoint, end, past, tolerance)
    lag_tube = state.hull_deviation.of(larger(state.largest.largest, increment))
    return occupancy(first, setpoint, end, past, tolerance, lag_tube)


def settle_measured(
    q: Joints, held: Sequence[Occupancy], tolerance: float, lag_tube: Joints = ()
) -> Joints | None:
    """Return the measured position to continue with; None if the measurement fits no held occupancy.

    The robot is inside the proven cover (which begins at a measurement too), and the measurement differs from
    its position by at most the rounding. A measurement that is inside the cover by ``lag_tube`` plus
    ``tolerance`` is returned unchanged. Otherwise, a position is admissible if no joint of it differs by more
    than that sum from any position that the robot can have, given this measurement. The admissible position
    nearest to the middle of the polyline's stretch that fits ``q`` is returned. So a measurement at the
    cover's edge is moved inside the cover, and a slow drift of a little each tick is noticed.

    Args:
        q: The measured position.
        held: The reserved occupancies.
        tolerance: Rounding of the measured q, rad or m.
        lag_tube: Largest distance of the robot from its companion from now on, per joint; () if axes lag
            alike.
    """
    off = tuple([tolerance + e for e in lag_tube]) if lag_tube else (tolerance,) * len(q)
    tubes = [_at_tick(one) for one in held]
    inner = [tuple(map(sub, tube, off)) for tube in tubes]
    if any(map(_fits, repeat(q), held, inner)):
        return q
    found = [
        (_stretches(q, one, tube, tolerance), own) for one, tube, own in zip(held, tubes, inner, strict=True)
    ]
    near = [(p, tube) for stretches, tube in found for stretch in stretches for p in stretch]
    if not near:
        return None
    # The robot is near to some point of these stretches: each joint within ``off`` of [low, high].
    low = [min(p[j] - e[j] for p, e in near) for j in range(len(q))]
    high = [max(p[j] + e[j] for p, e in near) for j in range(len(q))]
    middles = [_between(*stretch, 0.5) for stretches, _ in found for stretch in stretches]
    middle = min(middles, key=lambda p: math.dist(p, q))
    rows = zip(q, middle, low, high, lag_tube or (0.0,) * len(q), strict=True)
    return tuple([min(max(p, min(x - e, hi)), max(x + e, lo)) for x, p, lo, hi, e in rows])


def _at_tick(one: Occupancy) -> Joints:
    """Return the tube without the part that counts between the ticks only."""
    return tuple(map(sub, one.tube, one.between)) if one.between else one.tube


def deviation(q: Joints, one: Occupancy) -> float:
    """Return the distance of ``q``, in its worst joint, from the nearest point of the polyline, rad or m."""
    near = [_nearest(q, a, b) for a, b in one.segments]
    return min(max(abs(x - y) for x, y in zip(q, p, strict=True)) for p in near)


def _without_repeats(nodes: tuple[Joints, ...]) -> tuple[Joints, ...]:
    return nodes[:1] + tuple([b for a, b in pairwise(nodes) if a != b])


def _largest_deviation(history: Sequence[Joints], a: Joints, b: Joints) -> list[float]:
    """Return the largest deviation of the history from the chord ab, per joint."""
    lag = [0.0] * len(a)
    for past in history:
        near = _nearest(past, a, b)
        lag = [max(e, abs(p - x)) for e, p, x in zip(lag, past, near, strict=True)]
    return lag


def _corner_cut(a: Joints, b: Joints, c: Joints) -> list[float]:
    first, second = math.dist(a, b), math.dist(b, c)
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


def _fits(q: Joints, one: Occupancy, tube: Joints) -> bool:
    """Return True if ``q`` is within ``tube`` of the polyline."""
    width = [e + _ROUNDING for e in tube]
    for a, b in one.segments:
        low, high = _shares(q, a, b, width)
        if low <= high:
            return True
    return False


def _stretches(q: Joints, one: Occupancy, tube: Joints, extra: float) -> list[tuple[Joints, Joints]]:
    """Return the stretches of the polyline within ``tube`` and ``extra`` of ``q``, each by its two ends."""
    width = [e + extra + _ROUNDING for e in tube]
    found = []
    for a, b in one.segments:
        low, high = _shares(q, a, b, width)
        if low <= high:
            found.append((_between(a, b, low), _between(a, b, high)))
    return found


def _shares(q: Joints, a: Joints, b: Joints, width: Sequence[float]) -> tuple[float, float]:
    """Return the shares of the way from a to b between which every joint of ``q`` is within its width.

    Comparisons instead of ``min`` and ``max``: this runs for every joint at every tick.
    """
    low, high = 0.0, 1.0
    for x, p, r, w in zip(q, a, b, width, strict=True):
        d = r - p
        if abs(d) >= _ROUNDING:
            s, t = (x - p - w) / d, (x - p + w) / d
            if t < s:
                s, t = t, s
            low = s if s > low else low
            high = t if t < high else high
        elif abs(x - p) > w + abs(d):
            return 1.0, 0.0
    return low, high


def _between(a: Joints, b: Joints, share: float) -> Joints:
    return tuple([p + share * (r - p) for p, r in zip(a, b, strict=True)])
