"""Checks of a tick: a link may report the increment that the gate's plan has for this tick, and nothing else.

A report of a link is accepted only if it agrees with the plan. The measured position has no counterpart in
the plan: `settle_measured` compares it with the occupancy.
"""

import math
from itertools import chain
from operator import add

from armgate.cell.urdf import MAX_NUMBER
from armgate.events import LinkState, Tick
from armgate.gate.joint_limits import ROUNDING
from armgate.gate.occupancy import settle_measured
from armgate.gate.robot import RobotState, same
from armgate.gate.standstill import within


def unusable(s: RobotState, event: Tick) -> str | None:
    """Return the reason why a tick cannot be used; None if it can."""
    rows = (event.q, event.setpoint, event.increment)
    if not len(event.q) == len(event.setpoint) == len(event.increment) == s.robot.model.n:
        return f"{s.name}'s link reports positions of another number of joints"
    # One sum suffices for nearly every tick: it is too large, or NaN, if any of the numbers is.
    if not (math.isfinite(event.time) and sum(map(abs, chain(*rows))) <= MAX_NUMBER):
        if not all(map(math.isfinite, chain(*rows, (event.time,)))):
            return f"{s.name}'s link reports a number that is not finite"
        if max(map(abs, chain(*rows)), default=0.0) > MAX_NUMBER:
            return f"{s.name}'s link reports a position out of range; expected numbers within ±{MAX_NUMBER:g}"
    if event.tick <= s.tick:
        return f"{s.name}'s link reports tick {event.tick} after tick {s.tick}"
    return None


def contradiction(s: RobotState, event: Tick) -> str | None:
    """Return a contradiction to the plan that the link should play; None if there is none."""
    if s.tick < 0:
        return _first_in_motion(s, event)
    if event.rebased:
        return _wrong_rebase(s, event)
    if event.plan is None:
        if any(s.brake):
            return f"{s.name}'s link ends its plan before the robot is at rest"
    elif s.held is None or event.plan != s.held.key or event.index != s.played + 1 or not s.remaining:
        return f"{s.name}'s link plays a plan that the gate did not send"
    if not within(event.increment, s.brake, ROUNDING):
        return f"{s.name}'s link plays an increment that its plan does not have"
    return _wrong_sum(s, event)


def _first_in_motion(s: RobotState, event: Tick) -> str | None:
    """Check the first tick of a link: it comes before any plan of the gate."""
    return f"{s.name}'s link begins with a robot in motion" if _plays(event) else None


def _plays(event: Tick) -> bool:
    return event.plan is not None or event.index != -1 or any(event.increment)


def _wrong_sum(s: RobotState, event: Tick) -> str | None:
    if same(tuple(map(add, s.setpoint, event.increment)), event.setpoint):
        return None
    return f"{s.name}'s link reports a setpoint that its increments do not add up to"


def _wrong_rebase(s: RobotState, event: Tick) -> str | None:
    """Check a rebased tick.

    A robot that was held rests at a setpoint where the gate can expect it. A link that is not ready may start
    again at another position.
    """
    if _plays(event):
        return f"{s.name}'s link reports a robot that is held and moves at the same time"
    if s.link is not LinkState.READY or any(same(one, event.setpoint) for one in (s.setpoint, s.before)):
        return None
    occupied = [r.occupied for r in s.reserved]
    if settle_measured(event.setpoint, occupied, s.robot.q_tolerance) is None:
        return f"{s.name}'s link holds its robot at a position that the gate never commanded"
    return None
