"""What a robot's own bounds leave of a wish: increment bound, acceleration box, joint limits with braking.

The wish is clamped joint by joint first, so that one joint at its limit does not freeze the arm, and then,
where the joints' common stop still leaves the limits, blended toward the held path's next braking increment
u_b: u = u_b + β(u_wanted − u_b) with the largest β found for which the whole stop stays inside. u_b itself is
always possible: its stop is the rest of what was proven before.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

from armgate.events import Cause, Joints, Reason
from armgate.gate.braking import largest_stopping, stop_share, ticks_to_rest

ROUNDING = 1e-12
"""Room for floating-point rounding at a bound, rad or m."""

_BISECTIONS = 24

_UNITS = {"revolute": (180.0 / pi, " deg"), "prismatic": (1e3, " mm")}


@dataclass(frozen=True, slots=True)
class StepBounds:
    """One robot's bounds per tick: speed, acceleration and deceleration times T or T², and joint limits.

    ``kinds`` holds "revolute" or "prismatic" for each joint; it serves the texts of reasons only.
    """

    names: tuple[str, ...]
    lower: Joints
    upper: Joints
    speed: Joints
    accel: Joints
    decel: Joints
    kinds: tuple[str, ...] = ()

    def amount(self, joint: int, value: float) -> str:
        """Return a position or an increment of a joint with its unit, rounded."""
        factor, unit = _UNITS[self.kinds[joint]] if self.kinds else (1.0, "")
        return f"{round(factor * value, 6) + 0.0:.6g}{unit}"  # + 0: no -0


@dataclass(frozen=True, slots=True)
class Wish:
    """What is left of a wish: the increment, its blend β, and what bound it."""

    u: Joints
    beta: float
    reasons: tuple[Reason, ...]


def shape_wish(
    dq: Joints, last: Joints, brake: Joints, setpoint: Joints, bounds: StepBounds, share: float
) -> Wish:
    """Returns the largest part of the wish ``dq`` that the robot's own bounds allow.

    Args:
        dq: The wish, rad or m per joint.
        last: The increment played last (what the acceleration is counted from).
        brake: u_b, the held path's next braking increment.
        setpoint: Commanded position q_ref that the increment will be added to.
        bounds: The robot's bounds; limits already widened where it starts outside.
        share: The lease's own speed bound, a fraction.
    """
    if _is_free(dq, last, bounds, share) and stays_inside(dq, setpoint, bounds) is None:
        return Wish(dq, 1.0, ())
    u, reasons = _clamp_speed(dq, bounds, share)
    u, more = _clamp_acceleration(u, last, bounds)
    reasons += more
    if stays_inside(u, setpoint, bounds) is None:
        return Wish(u, 1.0, tuple(reasons))
    u, more = _clamp_limits(u, last, setpoint, bounds)
    reasons += more
    u, beta, more = _blend_into_limits(u, brake, setpoint, bounds)
    return Wish(u, beta, tuple(reasons + more))


def _is_free(u: Joints, last: Joints, bounds: StepBounds, share: float) -> bool:
    """Whether no joint's speed or acceleration bound binds: almost always, and found faster than clamped."""
    for x, before, speed, accel, decel in zip(u, last, bounds.speed, bounds.accel, bounds.decel, strict=True):
        if abs(x) > share * speed:
            return False
        low, high = acceleration_box(before, accel, decel)
        if not low <= x <= high:
            return False
    return True


def acceleration_box(last: float, accel: float, decel: float) -> tuple[float, float]:
    """Return the increments that one joint may take after ``last``.

    Away from zero it gains at most ``accel``, toward zero it loses at most ``decel``; through zero the rest
    of the tick accelerates: |last|/decel + |u|/accel ≤ 1.
    """
    if last < 0.0:
        low, high = acceleration_box(-last, accel, decel)
        return -high, -low
    back = last - decel if last >= decel else -accel * (1.0 - last / decel)
    return back, last + accel


def _follows(j: int, last: Joints, bounds: StepBounds) -> tuple[float, float]:
    """Return the acceleration box of a joint, within its speed bound whatever was played last."""
    low, high = acceleration_box(last[j], bounds.accel[j], bounds.decel[j])
    most = bounds.speed[j]
    return min(max(low, -most), most), min(max(high, -most), most)


def stays_inside(u: Joints, setpoint: Joints, bounds: StepBounds) -> int | None:
    """Returns the first joint whose stop after ``u`` leaves its limits, None if all stay inside."""
    reach = 1.0 + stop_share(ticks_to_rest(u, bounds.decel))
    ways = zip(u, setpoint, bounds.lower, bounds.upper, strict=True)
    for j, (x, q, lower, upper) in enumerate(ways):
        end = q + reach * x
        if (x > 0.0 and end > upper + ROUNDING) or (x < 0.0 and end < lower - ROUNDING):
            return j
    return None


def blend(brake: Joints, wanted: Joints, beta: float) -> Joints:
    """Returns u_b + β(u_wanted − u_b), exactly u_b for β = 0 and exactly u_wanted for β = 1."""
    if beta >= 1.0:
        return wanted
    return tuple(b + beta * (w - b) for b, w in zip(brake, wanted, strict=True))


def _clamp_each(
    u: Sequence[float], box: Callable[[int], tuple[float, float]], cause: Cause, bounds: StepBounds
) -> tuple[Joints, list[Reason]]:
    out, reasons = [], []
    for j, x in enumerate(u):
        low, high = box(j)
        y = min(max(x, low), high)
        out.append(y)
        if abs(y - x) > ROUNDING:
            bound = low if x < low else high
            text = f"{bounds.names[j]}: {_WORDS[cause]} allows {bounds.amount(j, bound)} this tick, "
            text += f"asked for {bounds.amount(j, x)}"
            reasons.append(Reason(cause, text, joint=bounds.names[j], value=x, bound=bound))
    return tuple(out), reasons


_WORDS = {
    Cause.INCREMENT: "the speed bound",
    Cause.ACCELERATION: "the acceleration bound",
    Cause.JOINT_LIMIT: "the joint limit with braking",
}


def _clamp_speed(u: Joints, bounds: StepBounds, share: float) -> tuple[Joints, list[Reason]]:
    def box(j: int) -> tuple[float, float]:
        return -share * bounds.speed[j], share * bounds.speed[j]

    return _clamp_each(u, box, Cause.INCREMENT, bounds)


def _clamp_acceleration(u: Joints, last: Joints, bounds: StepBounds) -> tuple[Joints, list[Reason]]:
    def box(j: int) -> tuple[float, float]:
        return _follows(j, last, bounds)

    return _clamp_each(u, box, Cause.ACCELERATION, bounds)


def _clamp_limits(
    u: Joints, last: Joints, setpoint: Joints, bounds: StepBounds
) -> tuple[Joints, list[Reason]]:
    """First each joint's own stop, then the longer stop that it shares with the fastest joint.

    The acceleration box keeps the last word: what it does not let a joint lose in one tick, the blend must
    solve.
    """

    def own(j: int) -> tuple[float, float]:
        up = max(bounds.upper[j] - setpoint[j], 0.0)
        down = max(setpoint[j] - bounds.lower[j], 0.0)
        return _inside_box(j, -largest_stopping(down, bounds.decel[j]), largest_stopping(up, bounds.decel[j]))

    def _inside_box(j: int, low: float, high: float) -> tuple[float, float]:
        least, most = _follows(j, last, bounds)
        return min(low, most), max(high, least)

    alone, reasons = _clamp_each(u, own, Cause.JOINT_LIMIT, bounds)
    reach = 1.0 + stop_share(ticks_to_rest(alone, bounds.decel))

    def together(j: int) -> tuple[float, float]:
        up = max(bounds.upper[j] - setpoint[j], 0.0) / reach
        down = max(setpoint[j] - bounds.lower[j], 0.0) / reach
        return _inside_box(j, -down, up)

    shared, more = _clamp_each(alone, together, Cause.JOINT_LIMIT, bounds)
    return shared, reasons + more


def _blend_into_limits(
    wanted: Joints, brake: Joints, setpoint: Joints, bounds: StepBounds
) -> tuple[Joints, float, list[Reason]]:
    joint = stays_inside(wanted, setpoint, bounds)
    if joint is None:
        return wanted, 1.0, []
    beta, beyond = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (beta + beyond)
        if stays_inside(blend(brake, wanted, middle), setpoint, bounds) is None:
            beta = middle
        else:
            beyond = middle
    name = bounds.names[joint]
    limit = bounds.upper[joint] if wanted[joint] > 0.0 else bounds.lower[joint]
    text = f"{name}: the stop of all joints together would pass its limit {bounds.amount(joint, limit)}"
    reason = Reason(Cause.JOINT_LIMIT, text, joint=name, value=setpoint[joint], bound=limit)
    return blend(brake, wanted, beta), beta, [reason]
