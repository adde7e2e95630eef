"""The checks before any geometry: may this command be judged at all?

In this order; the first that fails refuses:
lease and fence → not stopped → link ready → based on a fresh tick → one per tick → right length → finite.
"""

import math
from collections.abc import Callable

from armgate.events import Cause, Command, LinkState, Reason
from armgate.gate.robot import RobotState

Check = Callable[[Command, RobotState, int], Reason | None]


def inadmissible(command: Command, state: RobotState, max_age: int) -> Reason | None:
    """Returns why a command cannot be judged, None if it can."""
    for check in _CHECKS:
        reason = check(command, state, max_age)
        if reason is not None:
            return reason
    return None


def _lease(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if state.fence is None:
        if state.stops:
            text = f"{state.name} is stopped ({_stops(state)}) and no client has its lease"
            return Reason(Cause.LEASE, f"{text}: an operator must reset it, then acquire it")
        return Reason(Cause.LEASE, f"no client has the lease of {state.name}: acquire it first")
    if command.fence != state.fence:
        return Reason(
            Cause.FENCE, f"fence {command.fence} is not that of the lease in force: acquire {state.name}",
            value=float(command.fence), bound=float(state.fence),
        )  # fmt: skip
    return None


def _stopped(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if not state.stops:
        return None
    return Reason(Cause.STOPPED, f"{state.name} is stopped ({_stops(state)}): an operator must reset it")


def _stops(state: RobotState) -> str:
    return f"stop {', '.join(str(stop) for stop in reversed(state.stops))}"


def _link(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if state.link is LinkState.READY and state.tick >= 0:
        return None
    return Reason(Cause.LINK, f"the link to {state.name} is {state.link.value}: wait until it is ready")


def _fresh(command: Command, state: RobotState, max_age: int) -> Reason | None:
    age = state.tick - command.based_on
    if age < 0:
        return Reason(
            Cause.AHEAD, f"based on tick {command.based_on}, but {state.name} is at tick {state.tick}",
            value=float(command.based_on), bound=float(state.tick),
        )  # fmt: skip
    if age > max_age:
        text = f"based on tick {command.based_on}, {age} ticks ago; max_age_ticks allows {max_age}"
        return Reason(Cause.STALE, text, value=float(age), bound=float(max_age))
    return None


def _free(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if state.slot <= state.tick:
        return None
    return Reason(Cause.OCCUPIED, f"tick {state.slot} of {state.name} has a command already: one per tick")


def _length(command: Command, state: RobotState, max_age: int) -> Reason | None:
    n = state.robot.model.n
    if len(command.dq) == n:
        return None
    text = f"dq has {len(command.dq)} values: {state.name} has {n} joints"
    return Reason(Cause.LENGTH, text, value=float(len(command.dq)), bound=float(n))


def _finite(command: Command, state: RobotState, max_age: int) -> Reason | None:
    for name, x in zip(state.bounds.names, command.dq, strict=True):
        if not math.isfinite(x):
            return Reason(Cause.NOT_FINITE, f"dq of {name} is {x}: send a finite number", joint=name)
    return None


_CHECKS: tuple[Check, ...] = (_lease, _stopped, _link, _fresh, _free, _length, _finite)
