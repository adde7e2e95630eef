"""Task: move the tool of a robot to a point."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.env.actions import finite_array
from armgate.env.errors import EnvError
from armgate.env.tasks import Arms, Assessment, Scene, positive, refuse_options

Array = NDArray[np.float64]

_DRAWS = 8
"""Number of goals that are drawn until one is farther away than the tolerance."""


class Reach:
    """Move a robot's tool to a goal, and end there.

    Goals are positions of the tool at random clear positions of the robot, so the robot can reach each of
    them. The option ``goal`` of ``reset`` sets a point instead.

    The reward of a step is 10 times the progress towards the goal in m, less 0.01; at the goal 10 more.

    ============  ============================================================================================
    observation   ``goal``: from the tool to the goal, world axes, 1: 1 m
    measures      ``distance``: from the tool to the goal, m; ``success``: 1 at the goal, else 0
    ============  ============================================================================================

    Args:
        robot: The robot; None: the agent's first.
        tolerance: Distance at which the goal is reached, m.

    Raises:
        EnvError: The tolerance is not a positive number.
    """

    def __init__(self, robot: str | None = None, tolerance: float = 0.05) -> None:
        self._robot = robot
        self._tolerance = positive("tolerance", tolerance)
        self._scene: Scene
        self._goal = self._way = np.zeros(3)

    def bind(self, scene: Scene) -> Mapping[str, int]:
        """Use the robot's model."""
        self._robot = scene.robots[0] if self._robot is None else self._robot
        if self._robot not in scene.robots:
            raise EnvError(
                f"reach: {self._robot!r} is not one of the agent's robots {', '.join(scene.robots)}"
            )
        self._scene = scene
        return {"goal": 3}

    def begin(self, arms: Arms, random: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Choose a goal that is farther from the tool than the tolerance, if there is one."""
        refuse_options(options, ("goal",))
        tool = self._tool(arms[self._name].q)
        if "goal" in options:
            self._goal = _point(options["goal"])
        else:
            for _ in range(_DRAWS):
                self._goal = self._tool(self._scene.clear_position(random)[self._name])
                if _norm(self._goal - tool) > 2.0 * self._tolerance:
                    break
        self._way = self._goal - tool

    def assess(self, arms: Arms) -> Assessment:
        """Return the reward for progress."""
        before = _norm(self._way)
        self._way = self._goal - self._tool(arms[self._name].q)
        distance = _norm(self._way)
        reached = distance <= self._tolerance
        reward = 10.0 * (before - distance) - 0.01 + 10.0 * reached
        return Assessment(reward, reached, {"distance": distance, "success": float(reached)})

    def observe(self) -> Mapping[str, Array]:
        """Return the way to the goal."""
        return {"goal": self._way}

    def state(self) -> tuple[Array, Array]:
        """Return the goal and the way to it."""
        return self._goal, self._way

    def restore(self, state: tuple[Array, Array]) -> None:
        """Continue with a goal and the way to it."""
        self._goal, self._way = state

    @property
    def _name(self) -> str:
        assert self._robot is not None
        return self._robot

    def _tool(self, q: Array) -> Array:
        robot = self._scene.cell.robot(self._name)
        return robot.model.frame(q, robot.tool).t


def _norm(way: Array) -> float:
    return math.sqrt(float(way @ way))


def _point(value: object) -> Array:
    point = finite_array(value)
    if point is None or point.shape != (3,):
        raise EnvError(f"reset option 'goal': {value!r}; expected a point of three finite numbers, m")
    return point
