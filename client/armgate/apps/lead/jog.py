"""Program of manual driving: query the input, and bound the requested motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.inputs import Input
from armgate.apps.lead.motions import Array, MotionRequest, RobotState
from armgate.apps.lead.playback import REACHED
from armgate.apps.lead.steering import Steering
from armgate.client import Tick, Verdict
from armgate.client.program import REST, Outcome


class JogProgram:
    """Drive until the input ends or an end is requested; the robot is then at rest; a `Program`.

    It fails if the input failed.

    Args:
        source: The input.
        steering: Turns requested motions into increments.
        report: Prints a line for users.

    Attributes:
        fields: Fields of the entries that it reads.
        outcome: The outcome, once it has ended.
    """

    fields: Sequence[str] | None = ("q", "setpoint")

    def __init__(self, source: Input, steering: Steering, report: Callable[[str], object]) -> None:
        self.outcome = Outcome("driving")
        self._source = source
        self._steering = steering
        self._reporter = _ObstructionReporter(report)
        self._last = LastIncrement()
        self._ended = MotionRequest()
        self._interrupted = False

    def step(self, tick: Tick) -> Array | tuple[float, ...] | None:
        """Return the next increment (n,): the requested motion within the bounds."""
        setpoint = np.array(tick.setpoint)
        played = self._last.update(tick.tick, tick.setpoint)
        resting = bool(np.all(np.abs(played) < REACHED))
        request = self._request(tick, setpoint)
        if request.ended and resting:
            self.outcome = _outcome(tick.robot, request)
            return None
        motion = None if request.ended else request.motion
        # At rest without a motion, the SDK keeps the lease.
        return REST if motion is None and resting else self._steering.step(motion, setpoint, played)

    def signals(self) -> dict[str, float]:
        """Return no signals."""
        return {}

    def verdict(self, verdict: Verdict) -> None:
        """Report when the gate begins or ceases to obstruct the robot."""
        self._reporter.update(verdict)

    def interrupt(self) -> bool:
        """Request the end: the robot brakes to rest first."""
        self._interrupted = True
        return True

    def _request(self, tick: Tick, setpoint: Array) -> MotionRequest:
        """Return the request of this tick; an input that has ended is not queried again."""
        if self._interrupted:
            self._ended = MotionRequest(ended="interrupted")
        if self._ended.ended:
            return self._ended
        request = self._source.request(RobotState(tick.time, setpoint, np.array(tick.q), _others(tick)))
        if request.ended:
            self._ended = request
        return request


def _others(tick: Tick) -> dict[str, Array]:
    entries = (entry for entry in tick.state.entries if entry.robot != tick.robot and entry.q)
    return {entry.robot: np.array(entry.q) for entry in entries}


def _outcome(robot: str, ended: MotionRequest) -> Outcome:
    if ended.failed:
        return Outcome(f"{robot}: {ended.ended}; it is at rest", failed=True)
    return Outcome(f"{ended.ended}, at rest")


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
