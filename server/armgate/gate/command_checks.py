"""Checks of a command before any geometry. The first check that fails refuses the command.

Order: lease and fence → not stopped → link ready → age (based on a fresh tick) → one per tick → right
length → finite.
"""

import math
from collections.abc import Callable

from armgate.events import Command, LinkState, Reason
from armgate.gate import verdict_wording
from armgate.gate.robot import RobotState

Check = Callable[[Command, RobotState, int], Reason | None]


def failed_check(command: Command, state: RobotState, max_age: int) -> Reason | None:
    """Return the reason of the first check that fails; None if all pass.

    Args:
        command: The command.
        state: State of its robot.
        max_age: Largest age of a command, in ticks.
    """
    for check in _CHECKS:
        reason = check(command, state, max_age)
        if reason is not None:
            return reason
    return None


def _lease(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if state.fence is None:
        return verdict_wording.no_lease(state.name, state.stops)
    if not command.holder:
        return verdict_wording.not_the_holder(state.name, command.fence)
    if command.fence != state.fence:
        return verdict_wording.wrong_fence(state.name, command.fence, state.fence)
    return None


def _stopped(command: Command, state: RobotState, max_age: int) -> Reason | None:
    return verdict_wording.stopped(state.name, state.stops) if state.stops else None


def _link(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if state.link is LinkState.READY and state.tick >= 0:
        return None
    return verdict_wording.link_not_ready(state.name, state.link.value)


def _age(command: Command, state: RobotState, max_age: int) -> Reason | None:
    age = state.tick - command.based_on
    if age < 0:
        return verdict_wording.ahead(state.name, command.based_on, state.tick)
    if age > max_age:
        return verdict_wording.stale(command.based_on, age, max_age)
    return None


def _one_per_tick(command: Command, state: RobotState, max_age: int) -> Reason | None:
    return None if state.slot <= state.tick else verdict_wording.tick_taken(state.name, state.slot)


def _length(command: Command, state: RobotState, max_age: int) -> Reason | None:
    joints = state.robot.model.n
    if len(command.dq) == joints:
        return None
    return verdict_wording.wrong_length(state.name, len(command.dq), joints)


def _finite(command: Command, state: RobotState, max_age: int) -> Reason | None:
    if all(map(math.isfinite, command.dq)):
        return None
    for name, x in zip(state.bounds.names, command.dq, strict=True):
        if not math.isfinite(x):
            return verdict_wording.not_finite(name, x)
    return None


_CHECKS: tuple[Check, ...] = (_lease, _stopped, _link, _age, _one_per_tick, _length, _finite)
