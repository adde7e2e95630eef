"""Manual driving of one robot: find the robot, build its bounds, acquire its lease, run the loop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armgate.apps.errors import UsageError, text_of
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.drive import bounds_of
from armgate.apps.lead.inputs import InputFactory, Mode, Setting
from armgate.apps.lead.jog import JogProgram
from armgate.apps.lead.steering import Steering, Tool
from armgate.client import Cell, Description, RobotDescription
from armgate.client.program import ProgramCell, run


@dataclass(frozen=True)
class ManualDrive:
    """Options of manual driving.

    Attributes:
        make: Factory of the input.
        robot: Name of the robot; None if the cell has only one.
        mode: Initial mode of the input.
        speed: Largest share of the robot's speeds.
    """

    make: InputFactory
    robot: str | None
    mode: Mode
    speed: float


def drive_by_hand(
    cell: Cell, manual: ManualDrive, interrupt: Interrupt, report: Callable[[str], object]
) -> str:
    """Drive until the input ends; return the outcome in words.

    Raises:
        UsageError: The cell has no such robot.
        AppError: The input failed; the robot is at rest.
        ClientError: The lease was refused or lost, the robot was stopped, or the connection was lost.
    """
    described = described_in(cell.description, manual.robot)
    steering = steering_of(cell, described, manual.speed)
    source = manual.make(Setting(described, manual.mode, report))
    try:
        program = JogProgram(source, steering, report)
        outcome = run(cell, described.name, program, interrupt=interrupt, report=report)
        return f"{described.name}: {text_of(outcome)}"
    finally:
        source.close()


def steering_of(cell: ProgramCell, robot: RobotDescription, speed: float) -> Steering:
    """Return the steering of a robot, including its tool if the cell's libraries are installed."""
    return Steering(
        bounds_of(robot),
        np.array([joint.lower for joint in robot.joints]),
        np.array([joint.upper for joint in robot.joints]),
        speed,
        _tool_of(cell, robot),
    )


def _tool_of(cell: ProgramCell, robot: RobotDescription) -> Tool | None:
    try:
        from armgate.cell.model import RobotModel  # noqa: PLC0415
        from armgate.cell.placement import Placement  # noqa: PLC0415
        from armgate.control.redundancy.tasks import ROWS, FrameTask  # noqa: PLC0415
    except ModuleNotFoundError:  # a light install can still move joints
        return None
    base = Placement.from_quaternion(robot.base_xyz, robot.base_xyzw)
    return FrameTask(RobotModel.from_urdf(cell.urdf(robot.name), base), robot.tool, ROWS)


def described_in(cell: Description, robot: str | None) -> RobotDescription:
    """Return the description of the named robot; with None, of the only robot.

    Raises:
        UsageError: The cell has no such robot, or no name was given and it has several.
    """
    known = {described.name: described for described in cell.robots}
    if robot is None and len(known) == 1:
        return next(iter(known.values()))
    if robot not in known:
        wanted = "several robots; name the one to drive (--robot)" if robot is None else f"no robot {robot!r}"
        raise UsageError(f"cell {cell.name!r} has {wanted}; expected one of {', '.join(known)}")
    return known[robot]
