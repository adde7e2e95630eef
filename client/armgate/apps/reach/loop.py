"""Loop of ``armgate reach``: one increment per tick until the target is reached or cannot be reached."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError, UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.path import format_path
from armgate.apps.reach.goal import Arm, Goal, build
from armgate.apps.shared_signals import SharedSignals
from armgate.client import Cell, Robot, RobotDescription, Verdict
from armgate.control.bounds import IncrementBounds

Array = NDArray[np.float64]

AT_REST = 1e-9
"""Increment below which the robot is at rest, rad or m."""
SETTLED = 1e-3
"""Share of the largest joint speeds below which a robot counts as settling."""
SETTLE = 0.25
"""Time below that speed after which a robot counts as settled, s."""
STALL = 3.0
"""Time after which the motion counts as stuck if the error has not fallen by the tolerance, s."""


@dataclass
class Done:
    """Outcome of the motion.

    Attributes:
        text: The outcome in words.
        reached: True if the target was reached; None if the motion was interrupted.
        setpoints: Setpoints at all ticks, (k, n).
    """

    text: str
    reached: bool | None
    setpoints: Array

    def check(self, robot: str) -> None:
        """Fail the command if the target was not reached.

        Raises:
            AppError: It was not reached; the text gives the reason.
        """
        if self.reached is False:
            raise AppError(f"{robot}: {self.text}")


@dataclass
class EndCriteria:
    """Criteria for the end of the motion.

    Attributes:
        tolerance: Convergence tolerance, m and rad.
        duration: Timeout, s.
        limit: Reason for which the gate limited or refused the newest command; "" if it was admitted.
    """

    tolerance: float
    duration: float
    limit: str = ""
    _begin: float | None = None
    _best: float = np.inf
    _improved: float = 0.0
    _moved: float = 0.0

    def update(self, time: float, error: float, pace: float) -> tuple[str, bool] | None:
        """Return the outcome in words, and True if the target is reached; None to continue.

        Args:
            time: Time of the tick, s.
            error: Norm of the remaining error, m and rad.
            pace: Largest joint speed, as a share of the joint's bound.
        """
        if self._begin is None:
            self._begin = self._improved = self._moved = time
        if pace > SETTLED:
            self._moved = time
        if error < self._best - self.tolerance or error <= self.tolerance:
            self._best, self._improved = error, time
        passed = time - self._begin
        if error <= self.tolerance and time - self._moved >= SETTLE:
            return f"target reached in {passed:.2f} s, {error:.1e} left", True
        if time - self._improved >= STALL:
            return f"stuck {error:.4g} from the target after {passed:.2f} s{self._why()}", False
        if passed >= self.duration:
            return f"timeout, {error:.4g} from the target{self._why()}", error <= self.tolerance
        return None

    def take(self, verdict: Verdict) -> None:
        """Store the reason for which the gate limited or refused the newest command, if it did."""
        self.limit = "" if verdict.outcome == "admitted" or not verdict.reasons else verdict.reasons[0].text

    def _why(self) -> str:
        return f": {self.limit}" if self.limit else ""


@dataclass
class Steps:
    """Increments from wanted joint velocities, within the gate's bounds."""

    bounds: IncrementBounds
    period: float
    _last: LastIncrement = field(default_factory=LastIncrement)

    def played(self, tick: int, setpoint: Array) -> Array:
        """Return the increment that the robot played last (n,)."""
        return self._last.update(tick, setpoint.tolist())

    def increment(self, qd: Array, last: Array, setpoint: Array) -> Array:
        """Return the increment for q̇, scaled as a whole to the speed bounds, within all other bounds."""
        dq = qd * self.period
        dq = dq / max(1.0, float((np.abs(dq) / self.bounds.step).max()))
        return self.bounds.within(dq, last, setpoint)

    def pace(self, increment: Array) -> float:
        """Return the largest joint speed, as a share of the joint's bound."""
        return float((np.abs(increment) / self.bounds.step).max())


def run(
    cell: Cell,
    robot: str,
    goal: Goal,
    interrupt: Interrupt,
    report: Callable[[str], object],
    *,
    tolerance: float,
    duration: float,
    out: Path | None,
) -> str:
    """Acquire a robot, move its frame to the goal, and write the motion to ``out``.

    Returns:
        The outcome in words.

    Raises:
        UsageError: There is no such robot, frame or row, or the motion cannot be written.
        AppError: The target was not reached; the robot is at rest.
        ClientError: The lease was refused or lost, the robot was stopped, or the connection was lost.
    """
    arm = build(cell, robot, goal)
    cell.subscribe(every=1, robots=[robot], fields=["q", "setpoint"])
    with cell.acquire(robot) as held:
        signals = SharedSignals(cell, report)
        done = drive(signals, held, arm, interrupt, tolerance=tolerance, duration=duration)
    if out is not None:
        write_motion(out, arm.robot, done.setpoints)
    done.check(robot)
    return done.text


def drive(
    sharing: SharedSignals, robot: Robot, arm: Arm, interrupt: Interrupt, *, tolerance: float, duration: float
) -> Done:
    """Drive until the target is reached and the objectives have settled, or until a failure, and to rest.

    Raises:
        Lost: The lease was lost or the robot was stopped.
        ConnectionLost: The connection to the daemon was lost.
    """
    steps, criteria = Steps(arm.bounds, arm.robot.period), EndCriteria(tolerance, duration)
    setpoints: list[Array] = []
    controller = None
    ended: tuple[str, bool | None] | None = None
    for tick in robot.ticks():
        setpoint = np.array(tick.setpoint)
        setpoints.append(setpoint)
        played = steps.played(tick.tick, setpoint)
        if ended is not None:
            if np.all(np.abs(played) < AT_REST):
                break
            robot.send(arm.bounds.braked(played).tolist())
            continue
        controller = controller or arm.controller(setpoint)
        answer = controller.velocity(setpoint)
        error = float(np.linalg.norm(answer.error))
        sharing.share("reach.error", error)
        ended = (
            ("interrupted", None)
            if interrupt.requested
            else criteria.update(tick.time, error, steps.pace(played))
        )
        dq = arm.bounds.braked(played) if ended else steps.increment(answer.qd, played, setpoint)
        criteria.take(robot.send(dq.tolist()))
    assert ended is not None  # ticks end only by an exception
    return Done(f"{ended[0]}, at rest", ended[1], np.array(setpoints))


def write_motion(file: Path, robot: RobotDescription, setpoints: Array) -> None:
    """Write setpoints as a path file.

    Raises:
        UsageError: The file cannot be written.
    """
    joints = [(joint.name, joint.unit) for joint in robot.joints]
    try:
        file.write_text(format_path(robot.name, joints, robot.period, setpoints), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{file}: cannot be written ({error.strerror})") from error
