"""Lag of axes with different time constants: distance by which a robot may leave its setpoints' hull.

A robot whose joints all lag alike is at a weighted mean of its setpoints. If the lags τ_j differ, each joint
has weights of its own. Compare joint j with a companion that lags by the middle τ, |τ_j − τ| ≤ Δ = Δτ/2. Both
follow the setpoint s, with λ(t) = exp(−t/τ), so that a time t after a tick

    q − p = λ(t)·(q − p at the tick) + (λ_j(t) − λ(t))·(q − s at the tick).

If no increment exceeds M, |q − s| ≤ M/(1 − λ_j(T)). So a joint within M·Δ/T of its companion at one tick is
so at the next, because |1/(1 − λ_j(T)) − 1/(1 − λ(T))| ≤ Δ/T. Between ticks it is farther off by at most

    M·min(Δ/T·(x/(1 − e⁻ˣ) − 1), 1/(1 − e⁻ˣ)),   x = T/τ_j for the shortest lag.

The companion is only known to the tolerance r of the measurement. Each tick adds at most 2r, of which the
share λ(T) remains after one tick. The sum of all contributions is at most 2r/(1 − λ(T)).
"""

import math
from collections import deque
from dataclasses import dataclass
from operator import add

from armgate.cell.cell import Robot
from armgate.events import Joints

_LAGS = 20.0
"""Number of lags for which an increment counts: after that e⁻²⁰ of it is missing, less than rounding."""

_PARTS = 4


@dataclass(frozen=True, slots=True)
class HullDeviation:
    """Distance by which a moving joint may leave the hull, for its largest increment.

    Attributes:
        ticks: Distance at the ticks, where it is measured, as a share of the increment.
        between: Additional distance between two ticks, as a share of the increment.
        noise: Additional distance for the rounding of the measurement, rad or m.
    """

    ticks: float
    between: float
    noise: float

    def of(self, largest: Joints) -> tuple[Joints, Joints]:
        """Return the distance by which each joint may leave the hull, and the part between ticks only."""
        between = tuple([self.between * u for u in largest])
        at_ticks = [self.ticks * u + self.noise if u else 0.0 for u in largest]
        return tuple(map(add, at_ticks, between)), between


def hull_deviation_of(robot: Robot) -> HullDeviation | None:
    """Return the deviation of a robot's joints from the hull; None if they lag alike."""
    half, T, middle = robot.lag_difference / 2.0, robot.period, _middle(robot)
    if half == 0.0:
        return None
    shortest, gain = max(middle - half, 0.0), _gain(T, middle)
    between = 1.0 / _gain(T, shortest)
    if shortest > 0.0:
        between = min(half / T * (T / shortest * between - 1.0), between)
    return HullDeviation(half / T, between, (2.0 / gain - 1.0) * robot.q_tolerance)


def memory(robot: Robot) -> int:
    """Return the number of ticks for which an increment counts."""
    time = _LAGS * (_middle(robot) + robot.lag_difference / 2.0) + robot.lag_window
    return math.ceil(time / robot.period) + 1


def _gain(period: float, lag: float) -> float:
    """Return 1 − λ(T)."""
    return -math.expm1(-period / lag) if lag > 0.0 else 1.0


def _middle(robot: Robot) -> float:
    return (min(robot.lags) + max(robot.lags)) / 2.0


class LargestIncrements:
    """Largest increment of each joint in the last ``ticks`` ticks, or up to a quarter more.

    Args:
        ticks: Number of ticks for which an increment counts.
        joints: Number of joints.
    """

    def __init__(self, ticks: int, joints: int) -> None:
        self._length = math.ceil(ticks / _PARTS)
        self._count = 0
        self._parts: deque[Joints] = deque([(0.0,) * joints], maxlen=_PARTS + 1)
        self.largest: Joints = (0.0,) * joints
        """Largest increment per joint, rad or m."""

    @property
    def lasting(self) -> Joints:
        """Largest increments that still count at the next tick, rad or m."""
        parts = list(self._parts)[1:] if len(self._parts) > _PARTS else self._parts
        return tuple(map(max, *parts)) if len(parts) > 1 else parts[0]

    def add(self, increment: Joints) -> None:
        """Add the increment of one more tick."""
        if self._count == self._length:
            self._count = 0
            self._parts.append((0.0,) * len(increment))
        self._count += 1
        self._parts[-1] = larger(self._parts[-1], increment)
        self.largest = tuple(map(max, *self._parts)) if len(self._parts) > 1 else self._parts[0]


def larger(most: Joints, increment: Joints) -> Joints:
    """Return the larger magnitude of each joint's increment."""
    return tuple(max(m, abs(u)) for m, u in zip(most, increment, strict=True))
