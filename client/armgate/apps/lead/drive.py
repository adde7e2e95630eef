"""Loop of the leader: one increment per tick of its robot, with the progress shared as a signal."""

from collections.abc import Callable

import numpy as np

from armgate.apps.errors import PathError, UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.path import RecordedPath
from armgate.apps.lead.playback import REACHED, Playback
from armgate.apps.lead.shaping import Bounds
from armgate.apps.shared_signals import SharedSignals
from armgate.client import Cell, Description, Robot, RobotDescription, Verdict

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


def drive(
    cell: Cell, robot: Robot, playback: Playback, interrupt: Interrupt, report: Callable[[str], object]
) -> str:
    """Play the path to its end or, after an interruption, bring the robot to rest.

    Args:
        cell: Connection on which the progress is shared.
        robot: The robot, acquired.
        playback: Playback of the path.
        interrupt: Set when the process is requested to end.
        report: Prints a line for users.

    Returns:
        The outcome in words.

    Raises:
        Lost: The lease was lost or the robot was stopped.
        ConnectionLost: The connection to the daemon was lost.
    """
    last, settled, held, sharing = LastIncrement(), 0, False, SharedSignals(cell, report)
    for count, tick in enumerate(robot.ticks()):
        setpoint = np.array(tick.setpoint)
        played = last.update(tick.tick, tick.setpoint)
        if interrupt.requested and np.all(np.abs(played) < REACHED):
            return "interrupted, at rest"
        if playback.finished(setpoint, played):
            settled += 1
        if settled * playback.period > SETTLE:
            return f"{playback.end:.1f} s of the path played, at rest"
        if count % PROGRESS_EVERY == 0 or settled == 1:
            sharing.share("lead.progress", playback.progress)
        dq = playback.brake(played) if interrupt.requested else playback.step(setpoint, played)
        held = _report_held(robot.send(dq.tolist()), playback, held, report)
    raise AssertionError("ticks end only by an exception")


def _report_held(verdict: Verdict, playback: Playback, held: bool, report: Callable[[str], object]) -> bool:
    """Report once when the gate stops the progress of the path, and once when the path continues."""
    if playback.waiting and not held:
        why = verdict.reasons[0].text if verdict.reasons else verdict.outcome
        report(f"path held at {playback.time:.1f} s: {why}")
    elif held and not playback.waiting:
        report(f"path continues from {playback.time:.1f} s")
    return playback.waiting
