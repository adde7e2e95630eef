"""Bounds of one robot per tick."""

from dataclasses import dataclass
from math import pi

import numpy as np

from armgate.cell.cell import Robot
from armgate.events import Joints

_UNITS = {"revolute": (180.0 / pi, " deg"), "prismatic": (1e3, " mm")}


@dataclass(frozen=True, slots=True)
class StepBounds:
    """Joint limits of one robot, and its bounds of speed, acceleration and deceleration times T or T².

    ``kinds`` holds "revolute" or "prismatic" for each joint; only the texts of reasons use it.
    """

    names: tuple[str, ...]
    lower: Joints
    upper: Joints
    speed: Joints
    accel: Joints
    decel: Joints
    kinds: tuple[str, ...] = ()

    @classmethod
    def of(cls, robot: Robot) -> "StepBounds":
        """Return the bounds of a robot of the cell."""
        T, joints = robot.period, robot.model.joints
        return cls(
            names=tuple(j.name for j in joints),
            lower=_row(robot.lower),
            upper=_row(robot.upper),
            speed=_row(robot.velocity * T),
            accel=_row(robot.acceleration * T * T),
            decel=_row(robot.deceleration * T * T),
            kinds=tuple(j.kind for j in joints),
        )

    def amount(self, joint: int, value: float) -> str:
        """Return a position or an increment of a joint with its unit, rounded."""
        factor, unit = _UNITS[self.kinds[joint]] if self.kinds else (1.0, "")
        return f"{round(factor * value, 6) + 0.0:.6g}{unit}"  # + 0: no -0


def _row(values: np.ndarray) -> Joints:
    return tuple(float(x) for x in values)
