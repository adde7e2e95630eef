"""Range of joint positions for which a robot's motion bounds hold.

Only the travel of a prismatic joint behind a revolute one counts: it is the length of a lever. At first the
range covers the joint limits and the configured start. A robot may be found elsewhere: started outside its
limits, pushed by hand, or measured wrong. Then the range is fitted to the positions that the robot may have,
with some room, so that a moving robot does not need new bounds each tick. When the robot is back inside, the
first range applies again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Robot
from armgate.cell.model import RobotModel
from armgate.events import Joints
from armgate.gate.tracking_lag import hull_deviation_of

Array = NDArray[np.float64]

_SLACK = 1e-3
"""Room beyond the limits, m: tolerance of a measurement, and slack of a joint outside its limits."""

_STEP = 0.1
"""Room by which the range exceeds the positions that it must contain, m."""


@dataclass(frozen=True, eq=False)
class MotionBoundsRange:
    """Lowest and highest joint positions, (n,) each.

    Attributes:
        own: Ends of the limits and the configured start.
        ends: Ends as fitted.
        levers: Prismatic joints behind a revolute one.
    """

    own: tuple[Array, Array]
    ends: tuple[Array, Array]
    levers: tuple[int, ...]

    @classmethod
    def of(cls, robot: Robot) -> "MotionBoundsRange":
        """Return the range of a robot's limits and configured start."""
        deviation, room = hull_deviation_of(robot), _SLACK + 2.0 * robot.q_tolerance
        if deviation is not None:
            room += max(deviation.of(tuple(map(float, robot.velocity * robot.period)))[0])
        own = np.minimum(robot.lower, robot.start) - room, np.maximum(robot.upper, robot.start) + room
        return cls(own, own, _levers(robot.model))

    def fitted(self, nodes: Sequence[Joints], margin: float) -> "MotionBoundsRange":
        """Return the range for positions within ``margin`` of ``nodes``; this range if it need not change."""
        if not self.levers:
            return self
        low, high = np.min(nodes, axis=0) - margin, np.max(nodes, axis=0) + margin
        if self._holds(self.own, low, high):
            return self if self.ends is self.own else MotionBoundsRange(self.own, self.own, self.levers)
        if self._holds(self.ends, low, high):
            return self
        ends = np.minimum(self.own[0], low - _STEP), np.maximum(self.own[1], high + _STEP)
        return MotionBoundsRange(self.own, ends, self.levers)

    def _holds(self, ends: tuple[Array, Array], low: Array, high: Array) -> bool:
        lowest, highest = ends
        return all(lowest[j] <= low[j] and high[j] <= highest[j] for j in self.levers)


def _levers(model: RobotModel) -> tuple[int, ...]:
    """Return the prismatic joints that a revolute joint nearer to the base turns."""
    kinds = [joint.kind for joint in model.joints]
    turned = []
    for k, kind in enumerate(kinds):
        parent = model.parents[k]
        while parent >= 0 and kinds[parent] == "prismatic":
            parent = model.parents[parent]
        if kind == "prismatic" and parent >= 0:
            turned.append(k)
    return tuple(turned)
