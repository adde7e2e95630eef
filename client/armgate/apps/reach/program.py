"""Program of ``armgate reach``: increments until the target is reached or cannot be reached."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError, UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.path import format_path
from armgate.apps.reach.goal import Arm, Goal, build, tuning
from armgate.cell.placement import Placement
from armgate.client import Cell, RobotDescription, Tick, Verdict
from armgate.client.program import Outcome, ProgramContext, run
from armgate.control.bounds import IncrementBounds
from armgate.control.redundancy.reach import Reach

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


class ReachProgram:
    """Move until the target is reached and the objectives have settled, or until a failure; a `Program`.

    It then brings the robot to rest. It shares the remaining error as the signal ``reach.error``.

    Args:
        arm: Robot with its controller.
        criteria: Criteria for the end.

    Attributes:
        fields: Fields of the entries that it reads.
        outcome: The outcome, once it has ended.
        setpoints: Setpoints at all ticks so far, each (n,).
    """

    fields: Sequence[str] | None = ("q", "setpoint")

    def __init__(self, arm: Arm, criteria: EndCriteria) -> None:
        self.outcome = Outcome("moving")
        self.setpoints: list[Array] = []
        self._arm = arm
        self._criteria = criteria
        self._steps = Steps(arm.bounds, arm.robot.period)
        self._controller: Reach[Placement] | None = None
        self._error: float | None = None
        self._interrupted = self._ended = False

    def step(self, tick: Tick) -> Array | None:
        """Return the next increment (n,): towards the target, or braking at the end."""
        setpoint = np.array(tick.setpoint)
        self.setpoints.append(setpoint)
        played = self._steps.played(tick.tick, setpoint)
        self._error = None
        if self._ended:
            at_rest = np.all(np.abs(played) < AT_REST)
            return None if at_rest else self._arm.bounds.braked(played)
        self._controller = self._controller or self._arm.controller(setpoint)
        answer = self._controller.velocity(setpoint)
        self._error = float(np.linalg.norm(answer.error))
        if self._ends(tick.time, self._error, played):
            return self._arm.bounds.braked(played)
        return self._steps.increment(answer.qd, played, setpoint)

    def signals(self) -> dict[str, float]:
        """Return the remaining error, m and rad, until the end."""
        return {} if self._error is None else {"reach.error": self._error}

    def verdict(self, verdict: Verdict) -> None:
        """Store the reason of a limited or refused command."""
        if not self._ended:
            self._criteria.take(verdict)

    def interrupt(self) -> bool:
        """Request the end: the robot brakes to rest first."""
        self._interrupted = True
        return True

    def _ends(self, time: float, error: float, played: Array) -> bool:
        """Return True if the motion ends at this tick, and store its outcome."""
        if self._interrupted:
            self.outcome = Outcome("interrupted, at rest")
            self._ended = True
        elif found := self._criteria.update(time, error, self._steps.pace(played)):
            text, reached = found
            self.outcome = Outcome(f"{text}, at rest", failed=not reached)
            self._ended = True
        return self._ended


def reach(
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
    program = ReachProgram(arm, EndCriteria(tolerance, duration))
    outcome = run(cell, robot, program, interrupt=interrupt, report=report)
    if out is not None:
        write_motion(out, arm.robot, np.array(program.setpoints))
    if outcome.failed:
        raise AppError(f"{robot}: {outcome.text}")
    return outcome.text


def make(
    context: ProgramContext,
    *,
    tolerance: float = 1e-3,
    duration: float = 60.0,
    method: str = "damped",
    gain: float = 2.0,
    speed: float = 0.25,
    damping: float = 0.05,
    **goal: Any,
) -> ReachProgram:
    """Make the program; the options are those of ``armgate reach``.

    Args:
        context: The cell and the robot.
        tolerance: Convergence tolerance, m and rad.
        duration: Timeout, s.
        method: Inverse of the Jacobian: damped, variable, ….
        gain: Task velocity per error, 1/s.
        speed: Largest task velocity, m/s and rad/s.
        damping: Damping factor.
        goal: Further fields of `Goal`.

    Raises:
        UsageError: There is no such robot, frame or row.
        BadArgument: No robot was named.
    """
    wanted = Goal(**_GOAL | goal, tuning=tuning(method, gain, speed, damping))
    return ReachProgram(build(context.cell, context.own, wanted), EndCriteria(tolerance, duration))


_GOAL = {"frame": None, "rows": ("x", "y", "z"), "xyz": None, "rpy_deg": None, "objectives": (), "clear": 0.3}
"""Defaults of the goal of `make`."""


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
