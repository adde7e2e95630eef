"""Joint limits: the part of an increment that speed, acceleration and position limits with braking allow.

The increment is first clamped joint by joint, so that one joint at its limit does not freeze the arm. If the
common stop of all joints still leaves the limits, the increment is blended toward u_b, the held path's next
braking increment: u = u_b + β(u_wanted − u_b) with the largest β found for which the whole stop stays inside.
u_b itself is always possible: its stop is the remainder of a stop that was proven before.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from armgate.events import Cause, Joints, Reason
from armgate.gate import verdict_wording
from armgate.gate.braking import largest_stoppable_increment, stop_share, ticks_to_rest
from armgate.gate.step_bounds import StepBounds

ROUNDING = 1e-12
"""Room for floating-point rounding at a bound, rad or m."""

_BISECTIONS = 24

_Box = Callable[[int], tuple[float, float]]
"""Function that returns the lowest and the highest increment of a joint."""


class LimitedIncrement(NamedTuple):
    """Increment that the joint limits leave, its blend β, and the reasons why it is less than requested."""

    u: Joints
    beta: float
    reasons: tuple[Reason, ...]


def limit_increment(
    dq: Joints, last: Joints, brake: Joints, setpoint: Joints, bounds: StepBounds, share: float
) -> LimitedIncrement:
    """Return the largest part of the increment ``dq`` that the robot's own bounds allow.

    Args:
        dq: The requested increment, rad or m per joint.
        last: The increment played last (the acceleration counts from it).
        brake: u_b, the held path's next braking increment.
        setpoint: Commanded position q_ref to which the increment will be added.
        bounds: The robot's bounds; the limits are already widened for a robot that started outside.
        share: Speed bound of the lease, as a fraction of the robot's.
    """
    if _is_free(dq, last, bounds, share) and first_outside(dq, setpoint, bounds) is None:
        return LimitedIncrement(dq, 1.0, ())
    u, found = _clamp_speed(dq, bounds, share)
    u, more = _clamp_acceleration(u, last, bounds)
    found += more
    if first_outside(u, setpoint, bounds) is None:
        return LimitedIncrement(u, 1.0, tuple(found))
    u, more = _clamp_limits(u, last, setpoint, bounds)
    found += more
    u, beta, more = _blend_into_limits(u, brake, setpoint, bounds)
    return LimitedIncrement(u, beta, tuple(found + more))


def _is_free(u: Joints, last: Joints, bounds: StepBounds, share: float) -> bool:
    """Return True if no speed or acceleration bound binds: true for most commands, and cheap to check.

    The bounds are those of `acceleration_box`, written out: this runs for every joint of every command.
    """
    for x, before, speed, accel, decel in zip(u, last, bounds.speed, bounds.accel, bounds.decel, strict=True):
        if abs(x) > share * speed:
            return False
        away, fast = (x, before) if before >= 0.0 else (-x, -before)
        low = fast - decel if fast >= decel else -accel * (1.0 - fast / decel)
        if not low <= away <= fast + accel:
            return False
    return True


def acceleration_box(last: float, accel: float, decel: float) -> tuple[float, float]:
    """Return the lowest and the highest increment that one joint may have after ``last``.

    Away from zero it gains at most ``accel``, toward zero it loses at most ``decel``. If it passes zero, the
    rest of the tick accelerates: |last|/decel + |u|/accel ≤ 1.
    """
    if last < 0.0:
        low, high = acceleration_box(-last, accel, decel)
        return -high, -low
    back = last - decel if last >= decel else -accel * (1.0 - last / decel)
    return back, last + accel


def _acceleration_within_speed(j: int, last: Joints, bounds: StepBounds) -> tuple[float, float]:
    """Return the acceleration box of a joint, within its speed bound for any increment played last."""
    low, high = acceleration_box(last[j], bounds.accel[j], bounds.decel[j])
    most = bounds.speed[j]
    return min(max(low, -most), most), min(max(high, -most), most)


def first_outside(u: Joints, setpoint: Joints, bounds: StepBounds) -> int | None:
    """Return the first joint whose stop after ``u`` leaves its limits; None if all stay inside."""
    reach = 1.0 + stop_share(ticks_to_rest(u, bounds.decel))
    joints = zip(u, setpoint, bounds.lower, bounds.upper, strict=True)
    for j, (x, q, lower, upper) in enumerate(joints):
        end = q + reach * x
        if (x > 0.0 and end > upper + ROUNDING) or (x < 0.0 and end < lower - ROUNDING):
            return j
    return None


def blend(brake: Joints, wanted: Joints, beta: float) -> Joints:
    """Return u_b + β(u_wanted − u_b): exactly u_b for β = 0 and exactly u_wanted for β = 1."""
    if beta >= 1.0:
        return wanted
    return tuple(b + beta * (w - b) for b, w in zip(brake, wanted, strict=True))


def _clamp_each(
    u: Sequence[float], box: _Box, cause: Cause, bounds: StepBounds
) -> tuple[Joints, list[Reason]]:
    out, found = [], []
    for j, x in enumerate(u):
        low, high = box(j)
        y = min(max(x, low), high)
        out.append(y)
        if abs(y - x) > ROUNDING:
            found.append(verdict_wording.clamped(cause, bounds, j, x, low if x < low else high))
    return tuple(out), found


def _clamp_speed(u: Joints, bounds: StepBounds, share: float) -> tuple[Joints, list[Reason]]:
    def box(j: int) -> tuple[float, float]:
        return -share * bounds.speed[j], share * bounds.speed[j]

    return _clamp_each(u, box, Cause.INCREMENT, bounds)


def _clamp_acceleration(u: Joints, last: Joints, bounds: StepBounds) -> tuple[Joints, list[Reason]]:
    def box(j: int) -> tuple[float, float]:
        return _acceleration_within_speed(j, last, bounds)

    return _clamp_each(u, box, Cause.ACCELERATION, bounds)


def _clamp_limits(
    u: Joints, last: Joints, setpoint: Joints, bounds: StepBounds
) -> tuple[Joints, list[Reason]]:
    """Clamp each joint to its own stop, then to the longer stop that it shares with the fastest joint.

    The acceleration box has priority: if a joint cannot slow down enough in one tick, the blend handles that
    case.
    """

    def alone(j: int) -> tuple[float, float]:
        up = max(bounds.upper[j] - setpoint[j], 0.0)
        down = max(setpoint[j] - bounds.lower[j], 0.0)
        return within(
            j,
            -largest_stoppable_increment(down, bounds.decel[j]),
            largest_stoppable_increment(up, bounds.decel[j]),
        )

    def within(j: int, low: float, high: float) -> tuple[float, float]:
        least, most = _acceleration_within_speed(j, last, bounds)
        return min(low, most), max(high, least)

    clamped, found = _clamp_each(u, alone, Cause.JOINT_LIMIT, bounds)
    reach = 1.0 + stop_share(ticks_to_rest(clamped, bounds.decel))

    def together(j: int) -> tuple[float, float]:
        up = max(bounds.upper[j] - setpoint[j], 0.0) / reach
        down = max(setpoint[j] - bounds.lower[j], 0.0) / reach
        return within(j, -down, up)

    shared, more = _clamp_each(clamped, together, Cause.JOINT_LIMIT, bounds)
    return shared, found + more


def _blend_into_limits(
    wanted: Joints, brake: Joints, setpoint: Joints, bounds: StepBounds
) -> tuple[Joints, float, list[Reason]]:
    joint = first_outside(wanted, setpoint, bounds)
    if joint is None:
        return wanted, 1.0, []
    beta, beyond = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (beta + beyond)
        if first_outside(blend(brake, wanted, middle), setpoint, bounds) is None:
            beta = middle
        else:
            beyond = middle
    limit = bounds.upper[joint] if wanted[joint] > 0.0 else bounds.lower[joint]
    reason = verdict_wording.common_stop(bounds, joint, setpoint[joint], limit)
    return blend(brake, wanted, beta), beta, [reason]
