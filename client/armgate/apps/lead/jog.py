"""The loop that drives a robot by hand: ask the input, bound its wish, send the increment."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.increments import LastIncrement
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.inputs import Input
from armgate.apps.lead.motions import Array, MotionRequest, RobotState
from armgate.apps.lead.playback import REACHED
from armgate.apps.lead.steering import Steering
from armgate.client import Robot, Tick, Verdict


def jog(
    robot: Robot, source: Input, steering: Steering, interrupt: Interrupt, report: Callable[[str], object]
) -> str:
    """Drives until the input has ended or somebody interrupts; the robot is at rest then.

    Args:
        robot: The robot that is held.
        source: Where wishes come from.
        steering: Makes increments of them.
        interrupt: Whether somebody asked to end.
        report: Prints a line for people.

    Returns:
        How it ended, in words.

    Raises:
        AppError: The input failed; the robot is at rest.
        Lost: The lease was lost or the robot stopped.
        ConnectionLost: The daemon is gone.
    """
    last, told, ended = LastIncrement(), _Told(report), MotionRequest()
    for tick in robot.ticks():
        setpoint = np.array(tick.setpoint)
        played = last.update(tick.tick, tick.setpoint)
        resting = bool(np.all(np.abs(played) < REACHED))
        wish = MotionRequest(ended="interrupted") if interrupt.requested else ended
        if not wish.ended:
            wish = source.request(RobotState(tick.time, setpoint, np.array(tick.q), _others(tick)))
        if wish.ended:
            ended = wish
        if ended.ended and resting:
            return _how(robot, ended)
        motion = None if ended.ended else wish.motion
        if motion is not None or not resting:  # at rest with nothing to do the SDK keeps the lease
            told.verdict(robot.send(steering.step(motion, setpoint, played).tolist()))
    raise AssertionError("ticks end only by an exception")


def _others(tick: Tick) -> dict[str, Array]:
    entries = (entry for entry in tick.state.entries if entry.robot != tick.robot and entry.q)
    return {entry.robot: np.array(entry.q) for entry in entries}


def _how(robot: Robot, ended: MotionRequest) -> str:
    if ended.failed:
        raise AppError(f"{robot.name}: {ended.ended}; it is at rest")
    return f"{ended.ended}, at rest"


@dataclass
class _Told:
    """Says once what bounds the robot, and once that nothing does any more."""

    report: Callable[[str], object]
    _cause: str = field(default="", init=False)

    def verdict(self, verdict: Verdict) -> None:
        # Bounds on single increments come and go with every tick; what people can see is what is in the way.
        reason = next((r for r in verdict.reasons if r.cause in ("clearance", "joint_limit")), None)
        cause = "" if reason is None else reason.cause
        if cause != self._cause:
            self.report("the way is free again" if reason is None else f"held back: {reason.text}")
        self._cause = cause
