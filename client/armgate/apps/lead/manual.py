"""Drives one robot of a cell by hand: finds it, bounds the hand, takes the lease, runs the loop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armgate.apps.errors import UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.drive import bounds_of
from armgate.apps.lead.inputs import Input, Maker, Mode, Setting
from armgate.apps.lead.jog import jog
from armgate.apps.lead.steering import Steering, Tool
from armgate.client import Cell, Description, RobotDescription


@dataclass(frozen=True)
class ManualDrive:
    """Who drives what, and how.

    Attributes:
        make: Makes the input.
        robot: The robot; None: the only one.
        mode: What the input moves first.
        speed: The largest share of the robot's speeds.
    """

    make: Maker
    robot: str | None
    mode: Mode
    speed: float


def drive_by_hand(
    cell: Cell, hand: ManualDrive, interrupt: Interrupt, report: Callable[[str], object]
) -> str:
    """Drives until the input ends; returns how, in words.

    Raises:
        UsageError: There is no such robot.
        AppError: The input failed; the robot is at rest.
        ClientError: The lease was refused or lost, the robot stopped, the daemon is gone.
    """
    described = described_in(cell.description, hand.robot)
    steering = steering_of(cell, described, hand.speed)
    source = hand.make(Setting(described, hand.mode, report))
    try:
        return drive_by(source, cell, described.name, steering, interrupt, report)
    finally:
        source.close()


def drive_by(
    source: Input,
    cell: Cell,
    robot: str,
    steering: Steering,
    interrupt: Interrupt,
    report: Callable[[str], object],
) -> str:
    """Takes a robot and drives it by what an input wants; raises as `drive_by_hand`."""
    cell.subscribe(every=1, robots=[robot], fields=["q", "setpoint"])
    with cell.acquire(robot) as arm:
        return f"{robot}: {jog(arm, source, steering, interrupt, report)}"


def steering_of(cell: Cell, robot: RobotDescription, speed: float) -> Steering:
    """What bounds a hand that drives this robot, its tool too where the cell's libraries are installed."""
    return Steering(
        bounds_of(robot),
        np.array([joint.lower for joint in robot.joints]),
        np.array([joint.upper for joint in robot.joints]),
        speed,
        _tool_of(cell, robot),
    )


def _tool_of(cell: Cell, robot: RobotDescription) -> Tool | None:
    try:
        from armgate.cell.model import RobotModel  # noqa: PLC0415
        from armgate.cell.placement import Placement  # noqa: PLC0415
        from armgate.control.redundancy.tasks import ROWS, FrameTask  # noqa: PLC0415
    except ModuleNotFoundError:  # a light install: joints can be moved all the same
        return None
    base = Placement.from_quaternion(robot.base_xyz, robot.base_xyzw)
    return FrameTask(RobotModel.from_urdf(cell.urdf(robot.name), base), robot.tool, ROWS)


def described_in(cell: Description, robot: str | None) -> RobotDescription:
    """The robot of this name; None: the only one.

    Raises:
        UsageError: There is no such robot, or there are several.
    """
    known = {described.name: described for described in cell.robots}
    if robot is None and len(known) == 1:
        return next(iter(known.values()))
    if robot not in known:
        wanted = "name the robot to drive (--robot)" if robot is None else f"cell has no robot {robot!r}"
        raise UsageError(f"{wanted}; it has {', '.join(known)}")
    return known[robot]
