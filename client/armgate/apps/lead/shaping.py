"""Bounds of a leader's increments, so that its robot can follow them and stop; the gate adds its own."""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MARGIN = 0.7
"""Share of the acceleration bound used to plan braking; the rest is left for corrections."""

_TINY = 1e-12
"""Smallest distance that is used as a divisor, rad or m."""


@dataclass(frozen=True)
class Bounds:
    """Bounds of one robot's joints, per tick.

    Attributes:
        velocity: Largest speeds (n,), rad/s or m/s.
        acceleration: Largest accelerations (n,), per s².
        deceleration: Largest decelerations (n,), per s²; infinite without a bound.
        period: Period of the robot's ticks, s.
    """

    velocity: Array
    acceleration: Array
    deceleration: Array
    period: float

    @cached_property
    def increment(self) -> Array:
        """Largest increments (n,)."""
        return self.velocity * self.period

    @cached_property
    def gain(self) -> Array:
        """Largest increase of an increment from one tick to the next (n,)."""
        return self.acceleration * self.period**2

    @cached_property
    def loss(self) -> Array:
        """Planned decrease of an increment from one tick to the next (n,)."""
        return MARGIN * np.minimum(self.acceleration, self.deceleration) * self.period**2

    @cached_property
    def _joints(self) -> list[tuple[float, float]]:
        """Loss and largest increment of each joint."""
        return list(zip(self.loss.tolist(), self.increment.tolist(), strict=True))

    def approach(self, distance: Array, share: float = 1.0) -> Array:
        """Return the increment towards a position at rest, ``distance`` (n,) away, on a straight line.

        Each joint obeys two bounds: ``share`` of its largest increment, and u ≤ ½(−a + √(a² + 8aD)) =
        4aD / (a + √(a² + 8aD)). With the latter, u + (u − a) + (u − 2a) + … = D if u is a multiple of a,
        otherwise at most a/8 more. The increment is scaled as a whole by the tightest bound of all joints.
        """
        scale = 1.0
        # In a loop over numbers with comparisons: faster than arrays, and than min, for so few joints.
        for d, (a, most) in zip(distance.tolist(), self._joints, strict=True):
            D = abs(d)
            braking = 4.0 * a / (a + sqrt(a * a + 8.0 * a * D))
            cruising = share * most / (D if D > _TINY else _TINY)
            scale = braking if braking < scale else scale
            scale = cruising if cruising < scale else scale
        return distance * scale

    def reach(self, room: Array) -> Array:
        """Return the largest increments (n,) from which each joint can stop within ``room`` (n,) ≥ 0.

        With an integer k and 0 ≤ f < 1, u = (k + f)·a is followed by u − a, u − 2a, … f·a: the sum is
        ½a(k + 1)(k + 2f), which is solved for f. (``approach`` can exceed the room by up to a/8.)
        """
        D = room / self.loss
        k = np.floor((np.sqrt(1.0 + 8.0 * D) - 1.0) / 2.0)
        f = D / (k + 1.0) - k / 2.0
        return np.minimum((k + f) * self.loss, self.increment)

    def towards(self, wanted: Array, last: Array) -> Array:
        """Return the wanted increment, limited to what each joint can reach from the last one."""
        more = np.where(last < 0.0, self.loss, self.gain)
        less = np.where(last > 0.0, self.loss, self.gain)
        return np.clip(np.clip(wanted, last - less, last + more), -self.increment, self.increment)

    def limit(self, wanted: Array, last: Array) -> Array:
        """Return the wanted increment, each joint within its speed and acceleration bounds."""
        # Without np.clip, which takes three times as long for so few joints.
        near = np.minimum(np.maximum(wanted, last - self.gain), last + self.gain)
        return np.minimum(np.maximum(near, -self.increment), self.increment)

    def braking(self, last: Array) -> Array:
        """Return the next increment of a straight stop: the last one, reduced as much as all joints allow."""
        needs = float(np.max(np.abs(last) / self.loss))
        return last * max(0.0, 1.0 - 1.0 / needs) if needs > 0.0 else last
