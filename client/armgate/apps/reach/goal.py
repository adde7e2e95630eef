"""What ``armgate reach`` shall do, as a controller of the redundancy toolbox."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import UsageError
from armgate.apps.robot_models import bounds_of, described, model_of
from armgate.cell.errors import ModelError
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement, rotation_from_rpy
from armgate.cell.shapes import shape_from
from armgate.client import Cell, Description, RobotDescription
from armgate.control.bounds import IncrementBounds
from armgate.control.redundancy.objectives import (
    AwayFromObstacles,
    AwayFromSingularities,
    Objective,
    Obstacle,
    TowardsCentre,
)
from armgate.control.redundancy.reach import Method, Reach, Tuning
from armgate.control.redundancy.tasks import FrameTask

Array = NDArray[np.float64]

GAINS = {"singularities": 8.0, "limits": 1.0, "obstacles": 3.0}
"""Of the objectives, each in its own units: they come near their optimum in some seconds."""


@dataclass(frozen=True)
class Goal:
    """What was asked for.

    Attributes:
        frame: The frame that is brought; None for the robot's tool.
        rows: Which rows of it.
        xyz: Where to, world, m; None: where it is.
        rpy_deg: How turned, world, degrees; None: as it is.
        tuning: Which controller.
        objectives: Names out of ``GAINS``.
        clear: Nearer obstacles are kept away from, m.
    """

    frame: str | None
    rows: tuple[str, ...]
    xyz: tuple[float, float, float] | None
    rpy_deg: tuple[float, float, float] | None
    tuning: Tuning
    objectives: tuple[str, ...]
    clear: float


@dataclass(frozen=True)
class Arm:
    """A robot and what it shall do.

    Attributes:
        robot: As the daemon describes it.
        bounds: Of its increments.
        controller: Makes the controller, once the position is known from which it starts.
    """

    robot: RobotDescription
    bounds: IncrementBounds
    controller: Callable[[Array], Reach[Placement]]


def tuning(method: str, gain: float, speed: float, damping: float) -> Tuning:
    """Return the controller's tuning for a method's name."""
    return Tuning(Method(method), gain=gain, speed=speed, damping=damping)


def build(cell: Cell, name: str, goal: Goal) -> Arm:
    """The arm from what the daemon describes.

    Raises:
        UsageError: There is no such robot, frame or row.
    """
    robot = described(cell.description, name)
    model = model_of(cell, robot)
    try:
        task = FrameTask(model, goal.frame or robot.tool, goal.rows)
    except (ModelError, ValueError) as error:
        raise UsageError(f"robot {name!r}: {error}") from error
    objectives = [
        (objective(one, task, robot, goal, cell.description), GAINS[one]) for one in goal.objectives
    ]

    bounds = bounds_of(robot)

    def controller(q: Array) -> Reach[Placement]:
        limits = (bounds.lower, bounds.upper)
        return Reach(task, target(goal, task.place(q)), goal.tuning, objectives, limits)

    return Arm(robot, bounds, controller)


def target(goal: Goal, here: Placement) -> Placement:
    """Where to bring the frame that is here."""
    R = here.R if goal.rpy_deg is None else rotation_from_rpy([math.radians(a) for a in goal.rpy_deg])
    return Placement(R, here.t if goal.xyz is None else np.array(goal.xyz))


def objective(
    name: str, task: FrameTask, robot: RobotDescription, goal: Goal, cell: Description
) -> Objective:
    """The objective of this name."""
    if name == "singularities":
        return AwayFromSingularities(task)
    if name == "limits":
        return TowardsCentre([j.lower for j in robot.joints], [j.upper for j in robot.joints])
    return away_from_surroundings(task.model, cell, goal.clear)


def away_from_surroundings(model: RobotModel, cell: Description, clear: float) -> AwayFromObstacles:
    """Away from all that stands in the cell and belongs to no robot."""
    obstacles = [
        Obstacle(shape_from(body.shape.kind, body.shape.size), Placement.from_quaternion(body.xyz, body.xyzw))
        for body in cell.bodies
        if body.robot is None
    ]
    return AwayFromObstacles(model, obstacles, clear)
