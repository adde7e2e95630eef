"""Wording of verdicts: the text and the numbers of each reason, in the order of the checks."""

import math
from collections.abc import Sequence

from armgate.events import Cause, Point, Reason
from armgate.gate.step_bounds import StepBounds

_DIGITS = 9
"""Decimals of lengths in reasons, m: a nanometre."""

_BOUNDS = {
    Cause.INCREMENT: "the speed bound",
    Cause.ACCELERATION: "the acceleration bound",
    Cause.JOINT_LIMIT: "the joint limit with braking",
}

MEANINGS: dict[Cause, str] = {
    Cause.LEASE: "No client holds the lease of the robot: acquire it first.",
    Cause.FENCE: "The command lacked the fence of the lease in force, or its sender did not hold that lease.",
    Cause.STOPPED: "A stop is in force: an operator resets it, then the robot must be acquired again.",
    Cause.LINK: "The link to the robot was not ready.",
    Cause.STALE: "It was based on a state that is too old: the controller or the network was slow.",
    Cause.AHEAD: "It was based on a tick that has not come yet.",
    Cause.OCCUPIED: "The robot had a command for that tick already: one per robot and tick.",
    Cause.LENGTH: "Its number of increments differs from the number of joints.",
    Cause.NOT_FINITE: "It contained NaN or infinity.",
    Cause.INCREMENT: "It exceeded the joint's largest speed, or the lease's share of it.",
    Cause.ACCELERATION: "It exceeded the joint's largest acceleration or deceleration.",
    Cause.JOINT_LIMIT: "Even with braking, the robot would have passed the joint's limit.",
    Cause.CLEARANCE: "On its way to rest the robot could have come nearer than the distance to keep.",
}
"""Meaning of each cause in one sentence, for people."""


def no_lease(robot: str, stops: Sequence[int]) -> Reason:
    """Return the reason for a robot that is not leased, with its stops in force."""
    if stops:
        text = f"{robot} is stopped ({_stops(stops)}) and no client has its lease"
        return Reason(Cause.LEASE, f"{text}: an operator must reset the stop; then acquire the robot")
    return Reason(Cause.LEASE, f"no client has the lease of {robot}: acquire it first")


def wrong_fence(robot: str, fence: int, in_force: int) -> Reason:
    """Return the reason for a command with a fence other than that of the lease in force."""
    text = f"fence {fence} is not that of the lease in force: acquire {robot}"
    return Reason(Cause.FENCE, text, value=float(fence), bound=float(in_force))


def not_the_holder(robot: str, fence: int) -> Reason:
    """Return the reason for a command from a client other than the holder; it omits the holder's fence."""
    text = f"fence {fence} is not that of a lease of this client: acquire {robot}"
    return Reason(Cause.FENCE, text, value=float(fence))


def stopped(robot: str, stops: Sequence[int]) -> Reason:
    """Return the reason for a stopped robot."""
    return Reason(Cause.STOPPED, f"{robot} is stopped ({_stops(stops)}): an operator must reset it")


def _stops(stops: Sequence[int]) -> str:
    return f"stop {', '.join(str(stop) for stop in reversed(stops))}"


def link_not_ready(robot: str, state: str) -> Reason:
    """Return the reason for a robot whose link is not ready."""
    return Reason(Cause.LINK, f"the link to {robot} is {state}: wait until it is ready")


def positions_unknown(robots: Sequence[str]) -> Reason:
    """Return the reason for a cell in which robots have not reported a position yet."""
    text = f"the position of {', '.join(robots)} is not known yet: wait for its link"
    return Reason(Cause.LINK, text)


def ahead(robot: str, based_on: int, tick: int) -> Reason:
    """Return the reason for a command that is based on a tick in the future."""
    text = f"based on tick {based_on}, but {robot} is at tick {tick}"
    return Reason(Cause.AHEAD, text, value=float(based_on), bound=float(tick))


def stale(based_on: int, age: int, max_age: int) -> Reason:
    """Return the reason for a command that is based on a tick too long ago."""
    text = f"based on tick {based_on}, {age} ticks ago; max_age_ticks allows {max_age}"
    return Reason(Cause.STALE, text, value=float(age), bound=float(max_age))


def tick_taken(robot: str, tick: int) -> Reason:
    """Return the reason for a second command for the same tick."""
    return Reason(Cause.OCCUPIED, f"tick {tick} of {robot} has a command already: one per tick")


def wrong_length(robot: str, length: int, joints: int) -> Reason:
    """Return the reason for an increment whose number of values differs from that of the joints."""
    text = f"dq has {length} values: {robot} has {joints} joints"
    return Reason(Cause.LENGTH, text, value=float(length), bound=float(joints))


def not_finite(joint: str, value: float) -> Reason:
    """Return the reason for an increment of a joint that is infinite or not a number."""
    return Reason(Cause.NOT_FINITE, f"dq of {joint} is {value}: send a finite number", joint=joint)


def clamped(cause: Cause, bounds: StepBounds, joint: int, requested: float, allowed: float) -> Reason:
    """Return the reason for a joint whose increment was clamped to ``allowed``, rad or m."""
    text = f"{bounds.names[joint]}: {_BOUNDS[cause]} allows {bounds.amount(joint, allowed)} this tick, "
    text += f"but {bounds.amount(joint, requested)} was requested"
    return Reason(cause, text, joint=bounds.names[joint], value=requested, bound=allowed)


def common_stop(bounds: StepBounds, joint: int, setpoint: float, limit: float) -> Reason:
    """Return the reason for a joint that the common stop of all joints would take past its limit."""
    name = bounds.names[joint]
    text = f"{name}: the stop of all joints together would pass its limit {bounds.amount(joint, limit)}"
    return Reason(Cause.JOINT_LIMIT, text, joint=name, value=setpoint, bound=limit)


def outside_limit(bounds: StepBounds, joint: int, setpoint: float, limit: float) -> Reason:
    """Return the reason for a joint that is outside its limit and may only move back inside."""
    name = bounds.names[joint]
    text = f"{name} is outside its limit {bounds.amount(joint, limit)}: only motion back inside is allowed"
    return Reason(Cause.JOINT_LIMIT, text, joint=name, value=setpoint, bound=limit)


def too_near(pair: tuple[str, str], lb: float, limit: float, points: tuple[Point, Point] | None) -> Reason:
    """Return the reason for a pair of bodies that is not proven to keep its limit.

    Args:
        pair: Names of the bodies.
        lb: Lower bound of the distance that was proven, m; −∞ if nothing was proven.
        limit: Distance to keep, m.
        points: Witness points of the last engine query.
    """
    proven = f"{round(1e3 * lb, 1) + 0.0:.1f} mm" if math.isfinite(lb) else "no distance"
    text = f"{pair[0]} and {pair[1]}: {proven} could be proven on the way to rest, "
    text += f"{1e3 * limit:.1f} mm must be kept"
    value = math.floor(lb * 10**_DIGITS) / 10**_DIGITS if math.isfinite(lb) else None
    return Reason(Cause.CLEARANCE, text, pair=pair, value=value, bound=limit, points=_rounded(points))


def _rounded(points: tuple[Point, Point] | None) -> tuple[Point, Point] | None:
    if points is None:
        return None
    (a, b, c), (d, e, f) = points
    return (_length(a), _length(b), _length(c)), (_length(d), _length(e), _length(f))


def _length(x: float) -> float:
    return round(x, _DIGITS) + 0.0  # no minus zero
