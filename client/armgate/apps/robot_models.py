"""Models of robots, built from the daemon's description."""

import numpy as np

from armgate.apps.errors import UsageError
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.client import Description, RobotDescription
from armgate.client.program import ProgramCell
from armgate.control.bounds import IncrementBounds


def floor_of(cell: Description) -> float | None:
    """Return the height of the top of the body ``floor``, m; None unless it is a level box."""
    for body in cell.bodies:
        if (
            body.robot is None
            and body.name == "floor"
            and body.shape.kind == "box"
            and not any(body.xyzw[:2])
        ):
            return body.xyz[2] + body.shape.size[2] / 2
    return None


def described(cell: Description, robot: str) -> RobotDescription:
    """Return the description of a robot.

    Raises:
        UsageError: The cell has no robot with this name.
    """
    for found in cell.robots:
        if found.name == robot:
            return found
    known = ", ".join(found.name for found in cell.robots)
    raise UsageError(f"cell {cell.name!r} has no robot {robot!r}; it has {known}")


def model_of(cell: ProgramCell, robot: RobotDescription) -> RobotModel:
    """Return the robot's model, from its URDF and the pose of its base."""
    return RobotModel.from_urdf(
        cell.urdf(robot.name), Placement.from_quaternion(robot.base_xyz, robot.base_xyzw)
    )


def bounds_of(robot: RobotDescription) -> IncrementBounds:
    """Return the bounds of the robot's increments, as the gate applies them."""
    joints = robot.joints
    return IncrementBounds.from_rates(
        lower=[joint.lower for joint in joints],
        upper=[joint.upper for joint in joints],
        velocity=[joint.velocity for joint in joints],
        acceleration=[joint.acceleration for joint in joints],
        deceleration=[joint.deceleration or np.inf for joint in joints],
        period=robot.period,
    )
