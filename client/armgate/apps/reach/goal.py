"""Goal of ``armgate reach``, as a controller of the redundancy toolbox."""

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
from armgate.client import Description, RobotDescription
from armgate.client.program import ProgramCell
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
"""Gains of the objectives, each in its own units: they approach their optimum within some seconds."""


@dataclass(frozen=True)
class Goal:
    """Options of ``armgate reach``.

    Attributes:
        frame: Frame to move; None for the robot's tool.
        rows: Names of the task's rows.
        xyz: Target position, world, m; None to keep it.
        rpy_deg: Target orientation, world, degrees; None to keep it.
        tuning: Tuning of the controller.
        objectives: Names of null-space objectives, keys of ``GAINS``.
        clear: Distance below which obstacles repel the robot, m.
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
    """Robot with the controller that moves it to the goal.

    Attributes:
        robot: Description from the daemon.
        bounds: Bounds of its increments.
        controller: Makes the controller for the position from which the robot starts.
    """

    robot: RobotDescription
    bounds: IncrementBounds
    controller: Callable[[Array], Reach[Placement]]


def tuning(method: str, gain: float, speed: float, damping: float) -> Tuning:
    """Return the controller's tuning for a method's name."""
    return Tuning(Method(method), gain=gain, speed=speed, damping=damping)


def build(cell: ProgramCell, name: str, goal: Goal) -> Arm:
    """Build the arm from the daemon's description.

    Raises:
        UsageError: The cell has no such robot, or the robot has no such frame or row.
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
    """Return the target pose of the frame whose pose is ``here``."""
    R = here.R if goal.rpy_deg is None else rotation_from_rpy([math.radians(a) for a in goal.rpy_deg])
    return Placement(R, here.t if goal.xyz is None else np.array(goal.xyz))


def objective(
    name: str, task: FrameTask, robot: RobotDescription, goal: Goal, cell: Description
) -> Objective:
    """Return the objective with this name."""
    match name:
        case "singularities":
            return AwayFromSingularities(task)
        case "limits":
            return TowardsCentre([j.lower for j in robot.joints], [j.upper for j in robot.joints])
        case "obstacles":
            return away_from_surroundings(task.model, cell, goal.clear)
        case _:
            raise ValueError(f"unknown objective {name!r}; expected one of {', '.join(GAINS)}")


def away_from_surroundings(model: RobotModel, cell: Description, clear: float) -> AwayFromObstacles:
    """Return the objective to move away from all surroundings."""
    obstacles = [
        Obstacle(shape_from(body.shape.kind, body.shape.size), Placement.from_quaternion(body.xyz, body.xyzw))
        for body in cell.bodies
        if body.robot is None
    ]
    return AwayFromObstacles(model, obstacles, clear)
