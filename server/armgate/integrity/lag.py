"""Axes that lag differently: by how much the true position may leave the hull of the setpoints.

A robot whose joints all lag alike is at a weighted mean of its setpoints. If the lags τ_j differ, each joint
has weights of its own. Compare joint j with the same joint at the middle lag τ: increment u, played a time y
ago, is missing from both by exp(−y/τ_j) and exp(−y/τ). With |τ_j − τ| ≤ Δτ/2, the differences of all
increments, one every period T, add up to at most

    e_j = max |u_j| · (Δτ/(2T) + min(1, ln(τ/(τ − Δτ/2))/e)).

The first term is the integral of |exp(−y/τ_j) − exp(−y/τ)| over y, per period. The second is its maximum: a
setpoint that is held for a period moves in steps, and a sum over equal steps exceeds the integral of a
function with one peak by no more than the peak.
"""

import math
from collections import deque

from armgate.cell.cell import Robot
from armgate.cell.events import Joints

_LAGS = 20.0
"""An increment counts for so many lags: later e⁻²⁰ of it is missing, less than rounding."""

_PARTS = 4


def lag_share(robot: Robot) -> float:
    """Return e_j / max |u_j|; 0 if the axes lag alike."""
    half, lag = robot.lag_difference / 2.0, _middle(robot)
    if half == 0.0:
        return 0.0
    peak = math.log(lag / (lag - half)) / math.e if lag > half else 1.0
    return half / robot.period + min(1.0, peak)


def memory(robot: Robot) -> int:
    """Return for how many ticks an increment counts."""
    time = _LAGS * (_middle(robot) + robot.lag_difference / 2.0) + robot.lag_window
    return math.ceil(time / robot.period) + 1


def _middle(robot: Robot) -> float:
    return (min(robot.lags) + max(robot.lags)) / 2.0


class LargestIncrements:
    """The largest increment of each joint in the last ``ticks`` ticks, and at most a quarter of them more.

    Args:
        ticks: For how many ticks an increment counts.
        joints: How many joints there are.
    """

    def __init__(self, ticks: int, joints: int) -> None:
        self._length = math.ceil(ticks / _PARTS)
        self._count = 0
        self._parts: deque[Joints] = deque([(0.0,) * joints], maxlen=_PARTS + 1)
        self.largest: Joints = (0.0,) * joints
        """Per joint, rad or m."""

    def add(self, increment: Joints) -> None:
        """Take the increment of one more tick."""
        if self._count == self._length:
            self._count = 0
            self._parts.append((0.0,) * len(increment))
        self._count += 1
        self._parts[-1] = larger(self._parts[-1], increment)
        self.largest = tuple(map(max, *self._parts)) if len(self._parts) > 1 else self._parts[0]


def larger(most: Joints, increment: Joints) -> Joints:
    """Return the larger size of each joint's increment."""
    return tuple(max(m, abs(u)) for m, u in zip(most, increment, strict=True))
