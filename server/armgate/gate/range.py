"""Range of a robot's joints for which its motion bounds hold.

Only the travel of a prismatic joint behind a revolute one counts: it is the length of a lever. The range
begins as the joint limits and the configured start. A robot may be found elsewhere: started outside of its
limits, pushed by hand, or measured wrong. Then the range is fitted to where it may be, with some room, so
that a robot which goes on moving does not need new bounds each tick. Back inside, it has its own range again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Robot
from armgate.cell.model import RobotModel
from armgate.events import Joints
from armgate.gate.lag import stray_of

Array = NDArray[np.float64]

_SLACK = 1e-3
"""Room beyond the limits: for the tolerance of a measurement, and what a joint outside may fall back, m."""

_STEP = 0.1
"""How much farther than needed the range is widened, m."""


@dataclass(frozen=True, eq=False)
class Range:
    """Lowest and highest joint positions, (n,) each.

    Attributes:
        own: Of the limits and the configured start.
        ends: As fitted.
        levers: The joints that count.
    """

    own: tuple[Array, Array]
    ends: tuple[Array, Array]
    levers: tuple[int, ...]

    @classmethod
    def of(cls, robot: Robot) -> "Range":
        """Return the range of a robot's limits and configured start."""
        stray, room = stray_of(robot), _SLACK + 2.0 * robot.q_tolerance
        if stray is not None:
            room += max(stray.of(tuple(map(float, robot.velocity * robot.period)))[0])
        own = np.minimum(robot.lower, robot.start) - room, np.maximum(robot.upper, robot.start) + room
        return cls(own, own, _levers(robot.model))

    def fitted(self, nodes: Sequence[Joints], room: float) -> "Range":
        """Return the range for positions within ``room`` of ``nodes``; itself if it need not change."""
        if not self.levers:
            return self
        low, high = np.min(nodes, axis=0) - room, np.max(nodes, axis=0) + room
        if self._holds(self.own, low, high):
            return self if self.ends is self.own else Range(self.own, self.own, self.levers)
        if self._holds(self.ends, low, high):
            return self
        ends = np.minimum(self.own[0], low - _STEP), np.maximum(self.own[1], high + _STEP)
        return Range(self.own, ends, self.levers)

    def _holds(self, ends: tuple[Array, Array], low: Array, high: Array) -> bool:
        lowest, highest = ends
        return all(lowest[j] <= low[j] and high[j] <= highest[j] for j in self.levers)


def _levers(model: RobotModel) -> tuple[int, ...]:
    """The prismatic joints that a revolute one nearer to the base turns."""
    kinds = [joint.kind for joint in model.joints]
    turned = []
    for k, kind in enumerate(kinds):
        parent = model.parents[k]
        while parent >= 0 and kinds[parent] == "prismatic":
            parent = model.parents[parent]
        if kind == "prismatic" and parent >= 0:
            turned.append(k)
    return tuple(turned)
