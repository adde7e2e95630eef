"""Increments that a robot can follow and stop from: the leader's own bounds, before the gate bounds again."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MARGIN = 0.7
"""Share of the acceleration bound that braking is planned with: what is left corrects."""

_TINY = 1e-12
"""Below this a distance is nothing to divide by, rad or m."""


@dataclass(frozen=True)
class Bounds:
    """What one robot's joints can do, per tick of its clock.

    Attributes:
        velocity: Largest speeds (n,), rad/s or m/s.
        acceleration: Largest accelerations (n,), per s².
        deceleration: Largest decelerations (n,), per s²; infinite where there is no bound.
        period: The robot's tick, s.
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
        """Largest growth of an increment from one tick to the next (n,)."""
        return self.acceleration * self.period**2

    @cached_property
    def loss(self) -> Array:
        """Planned decrease of an increment from one tick to the next (n,)."""
        return MARGIN * np.minimum(self.acceleration, self.deceleration) * self.period**2

    def approach(self, distance: Array, share: float = 1.0) -> Array:
        """The increment towards a place at rest, ``distance`` (n,) away, on the straight line.

        Each joint obeys u ≤ ½(−a + √(a² + 8aD)) = 4aD / (a + √(a² + 8aD)), the largest first step of a
        sequence u, u − a, u − 2a, … that covers no more than D, and ``share`` of its largest increment; the
        slowest joint sets the pace.
        """
        D = np.abs(distance)
        a = self.loss
        braking = 4.0 * a / (a + np.sqrt(a * a + 8.0 * a * D))
        speed = share * self.increment / np.maximum(D, _TINY)
        return distance * min(1.0, float(braking.min()), float(speed.min()))

    def limit(self, wish: Array, last: Array) -> Array:
        """The wish, each joint within its increment and within its acceleration from the last increment."""
        near = np.clip(wish, last - self.gain, last + self.gain)
        return np.clip(near, -self.increment, self.increment)

    def braking(self, last: Array) -> Array:
        """The next increment of a straight stop: the last one, shrunk as far as every joint allows."""
        needs = float(np.max(np.abs(last) / self.loss))
        return last * max(0.0, 1.0 - 1.0 / needs) if needs > 0.0 else last
