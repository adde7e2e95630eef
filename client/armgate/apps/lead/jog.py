"""Loop of manual driving: query the input, bound the requested motion, send the increment."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.inputs import Input
from armgate.apps.lead.motions import Array, MotionRequest, RobotState
from armgate.apps.lead.playback import REACHED
from armgate.apps.lead.steering import Steering
from armgate.client import Robot, Tick, Verdict


def jog(
    robot: Robot, source: Input, steering: Steering, interrupt: Interrupt, report: Callable[[str], object]
) -> str:
    """Drive until the input ends or the process is interrupted; the robot is then at rest.

    Args:
        robot: The robot, acquired.
        source: The input.
        steering: Turns requested motions into increments.
        interrupt: Set when the process is requested to end.
        report: Prints a line for users.

    Returns:
        The outcome in words.

    Raises:
        AppError: The input failed; the robot is at rest.
        Lost: The lease was lost or the robot was stopped.
        ConnectionLost: The connection to the daemon was lost.
    """
    last, reporter, ended = LastIncrement(), _ObstructionReporter(report), MotionRequest()
    for tick in robot.ticks():
        setpoint = np.array(tick.setpoint)
        played = last.update(tick.tick, tick.setpoint)
        resting = bool(np.all(np.abs(played) < REACHED))
        request = MotionRequest(ended="interrupted") if interrupt.requested else ended
        if not request.ended:
            request = source.request(RobotState(tick.time, setpoint, np.array(tick.q), _others(tick)))
        if request.ended:
            ended = request
        if ended.ended and resting:
            return _outcome(robot, ended)
        motion = None if ended.ended else request.motion
        if motion is not None or not resting:  # at rest without a motion, the SDK keeps the lease
            reporter.update(robot.send(steering.step(motion, setpoint, played).tolist()))
    raise AssertionError("ticks end only by an exception")


def _others(tick: Tick) -> dict[str, Array]:
    entries = (entry for entry in tick.state.entries if entry.robot != tick.robot and entry.q)
    return {entry.robot: np.array(entry.q) for entry in entries}


def _outcome(robot: Robot, ended: MotionRequest) -> str:
    if ended.failed:
        raise AppError(f"{robot.name}: {ended.ended}; it is at rest")
    return f"{ended.ended}, at rest"


@dataclass
class _ObstructionReporter:
    """Reporter of obstructions: one report when the gate obstructs the robot, one when it no longer does."""

    report: Callable[[str], object]
    _cause: str = field(default="", init=False)

    def update(self, verdict: Verdict) -> None:
        # Bounds on single increments change with every tick; users can only see obstacles and joint limits.
        reason = next((r for r in verdict.reasons if r.cause in ("clearance", "joint_limit")), None)
        cause = "" if reason is None else reason.cause
        if cause != self._cause:
            self.report("no longer obstructed" if reason is None else f"obstructed: {reason.text}")
        self._cause = cause
