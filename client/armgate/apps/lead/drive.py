"""Checks of a path before it is played, and the program that plays it."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from armgate.apps.errors import PathError, UsageError
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.path import RecordedPath, read_path
from armgate.apps.lead.playback import REACHED, Playback
from armgate.apps.lead.shaping import Array, Bounds
from armgate.client import Description, RobotDescription, Tick, Verdict
from armgate.client.program import Outcome, ProgramContext, ignore

PROGRESS_EVERY = 4
"""Ticks between two updates of ``lead.progress``."""
SETTLE = 0.3
"""Wait after the last increment, s, until the robot has arrived and other clients have received the end."""


def check_path(path: RecordedPath, cell: Description, robot: str) -> RobotDescription:
    """Return the description of the robot if it can play the path.

    Raises:
        UsageError: The cell has no such robot.
        PathError: Joints or units differ, or a sample exceeds a position or speed limit; names the line.
    """
    known = {described.name: described for described in cell.robots}
    if robot not in known:
        raise UsageError(f"cell {cell.name!r} has no robot {robot!r}; it has {', '.join(known)}")
    described = known[robot]
    names, units = (tuple(getattr(joint, key) for joint in described.joints) for key in ("name", "unit"))
    if path.joints != names or path.units != units:
        has = " ".join(f"{name}[{unit}]" for name, unit in zip(names, units, strict=True))
        given = " ".join(f"{name}[{unit}]" for name, unit in zip(path.joints, path.units, strict=True))
        raise PathError(path.file, None, f"is for joints {given}; {robot} has {has}")
    _check_limits(path, described)
    return described


def _check_limits(path: RecordedPath, robot: RobotDescription) -> None:
    steps = np.abs(np.diff(path.q, axis=0))
    for j, joint in enumerate(robot.joints):
        column = path.q[:, j]
        outside = np.flatnonzero((column < joint.lower) | (column > joint.upper))
        if len(outside):
            where = path.line_of(int(outside[0]))
            limits = f"{joint.lower:.6g} to {joint.upper:.6g} {joint.unit}"
            raise PathError(path.file, where, f"{joint.name} at {column[outside[0]]:.6g}; expected {limits}")
        fast = np.flatnonzero(steps[:, j] > joint.velocity * path.period)
        if len(fast):
            where, speed = path.line_of(int(fast[0]) + 1), steps[fast[0], j] / path.period
            bound = f"{joint.velocity:.6g} {joint.unit}/s"
            raise PathError(path.file, where, f"{joint.name} moves at {speed:.6g}; expected at most {bound}")


def bounds_of(robot: RobotDescription) -> Bounds:
    """Return the bounds of the robot's joints per tick, from its description."""
    return Bounds(
        velocity=np.array([joint.velocity for joint in robot.joints]),
        acceleration=np.array([joint.acceleration for joint in robot.joints]),
        deceleration=np.array([joint.deceleration or np.inf for joint in robot.joints]),
        period=robot.period,
    )


class PathProgram:
    """Play a path to its end or, if an end is requested, bring the robot to rest; a `Program`.

    It shares its progress as the signal ``lead.progress``.

    Args:
        playback: Playback of the path.
        report: Prints a line for users.

    Attributes:
        fields: Fields of the entries that it reads.
        outcome: The outcome, once it has ended.
    """

    fields: Sequence[str] | None = ("q", "setpoint")

    def __init__(self, playback: Playback, report: Callable[[str], object]) -> None:
        self.outcome = Outcome("playing")
        self._playback = playback
        self._report = report
        self._last = LastIncrement()
        self._count = -1
        self._progress = 0.0
        self._settled = 0
        self._held = self._interrupted = False

    def step(self, tick: Tick) -> Array | None:
        """Return the next increment (n,): along the path, or braking at the end."""
        setpoint = np.array(tick.setpoint)
        played = self._last.update(tick.tick, setpoint)
        self._count += 1
        if self._interrupted and np.all(np.abs(played) < REACHED):
            self.outcome = Outcome("interrupted, at rest")
            return None
        if self._playback.finished(setpoint, played):
            self._settled += 1
        if self._settled * self._playback.period > SETTLE:
            self.outcome = Outcome(f"{self._playback.end:.1f} s of the path played, at rest")
            return None
        self._progress = self._playback.progress
        return self._playback.brake(played) if self._interrupted else self._playback.step(setpoint, played)

    def signals(self) -> dict[str, float]:
        """Return the progress, at some ticks."""
        due = self._count % PROGRESS_EVERY == 0 or self._settled == 1
        return {"lead.progress": self._progress} if due else {}

    def verdict(self, verdict: Verdict) -> None:
        """Report once when the gate stops the progress of the path, and once when the path continues."""
        playback = self._playback
        if playback.waiting and not self._held:
            why = verdict.reasons[0].text if verdict.reasons else verdict.outcome
            self._report(f"path held at {playback.time:.1f} s: {why}")
        elif self._held and not playback.waiting:
            self._report(f"path continues from {playback.time:.1f} s")
        self._held = playback.waiting

    def interrupt(self) -> bool:
        """Request the end: the robot brakes to rest first."""
        self._interrupted = True
        return True


def make(context: ProgramContext, *, path: str | Path, duration: float | None = None) -> PathProgram:
    """Make the program that plays a path file; it prints nothing.

    Raises:
        PathError: The file is malformed, or does not fit the robot.
        UsageError: The cell has no such robot.
        BadArgument: No robot was named.
    """
    recorded = read_path(Path(path))
    described = check_path(recorded, context.cell.description, context.own)
    return PathProgram(Playback(recorded, bounds_of(described), duration), ignore)
