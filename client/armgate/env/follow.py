"""Task: keep the camera of one robot on the tool of another robot."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.env.errors import EnvError
from armgate.env.tasks import Arms, Assessment, Scene, positive, refuse_options

Array = NDArray[np.float64]


class Follow:
    """Keep a robot's camera on the tool of another robot, at a wanted distance.

    The reward of a step is 1 less the angle error per 90° and less the distance error per wanted distance.

    ============  ============================================================================================
    observation   ``view``: direction to the tool in axes of the camera, three numbers; ``distance``: distance
                  error, 1: the wanted distance
    measures      ``angle_error``, rad; ``distance_error``, m
    ============  ============================================================================================

    Args:
        robot: Robot with the camera; None: the agent's first robot that has one.
        leader: Robot whose tool is followed; None: the first robot that the agent does not command.
        distance: Wanted distance, m.

    Raises:
        EnvError: The distance is not a positive number.
    """

    def __init__(self, robot: str | None = None, leader: str | None = None, distance: float = 1.0) -> None:
        self._robot, self._leader = robot, leader
        self._wanted = positive("distance", distance)
        self._scene: Scene
        self._way = np.zeros(3)

    def bind(self, scene: Scene) -> Mapping[str, int]:
        """Use the models of both robots."""
        cameras = [name for name in scene.robots if scene.cell.robot(name).camera is not None]
        self._robot = next(iter(cameras), "") if self._robot is None else self._robot
        self._leader = next(iter(scene.others), "") if self._leader is None else self._leader
        if self._robot not in cameras:
            raise EnvError(f"follow: {self._robot!r} is not a robot of the agent with a camera")
        if self._leader not in scene.others:
            raise EnvError(f"follow: {self._leader!r} is not a robot that the agent does not command")
        self._scene = scene
        return {"view": 3, "distance": 1}

    def begin(self, arms: Arms, random: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Refuse options."""
        refuse_options(options, ())
        self._look(arms)

    def assess(self, arms: Arms) -> Assessment:
        """Return the reward for small errors."""
        self._look(arms)
        x, y, z = self._way.tolist()
        across = math.hypot(x, y)
        angle, error = math.atan2(across, z), math.hypot(across, z) - self._wanted
        reward = 1.0 - angle / (0.5 * math.pi) - abs(error) / self._wanted
        return Assessment(reward, measures={"angle_error": angle, "distance_error": error})

    def observe(self) -> Mapping[str, Array]:
        """Return direction and distance error."""
        distance = float(np.linalg.norm(self._way))
        error = (distance - self._wanted) / self._wanted
        return {"view": self._way / max(distance, 1e-9), "distance": np.array([error])}

    def state(self) -> Array:
        """Return the way to the tool."""
        return self._way

    def restore(self, state: Array) -> None:
        """Continue with a way to the tool."""
        self._way = state

    def _look(self, arms: Arms) -> None:
        """Compute the way from the camera to the tool, in axes of the camera."""
        assert self._robot is not None
        assert self._leader is not None
        robot, leader = self._scene.cell.robot(self._robot), self._scene.cell.robot(self._leader)
        assert robot.camera is not None
        camera = robot.model.frame(arms[self._robot].q, robot.camera)
        self._way = camera.R.T @ (leader.model.frame(arms[self._leader].q, leader.tool).t - camera.t)
