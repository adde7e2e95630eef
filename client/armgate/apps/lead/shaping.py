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

    def reach(self, room: Array) -> Array:
        """The largest increments (n,) from which each joint can stop within ``room`` (n,) ≥ 0.

        u = (k + f)·a with the whole number k and 0 ≤ f < 1 is followed by u − a, u − 2a, … f·a: in all
        ½a(k + 1)(k + 2f), which is solved for f. (The formula of ``approach`` goes up to a/8 too far.)
        """
        D = room / self.loss
        k = np.floor((np.sqrt(1.0 + 8.0 * D) - 1.0) / 2.0)
        f = D / (k + 1.0) - k / 2.0
        return np.minimum((k + f) * self.loss, self.increment)

    def towards(self, wish: Array, last: Array) -> Array:
        """The wish, as far as each joint can speed up or slow down to it from the last increment."""
        more = np.where(last < 0.0, self.loss, self.gain)
        less = np.where(last > 0.0, self.loss, self.gain)
        return np.clip(np.clip(wish, last - less, last + more), -self.increment, self.increment)

    def limit(self, wish: Array, last: Array) -> Array:
        """The wish, each joint within its increment and within its acceleration from the last increment."""
        near = np.clip(wish, last - self.gain, last + self.gain)
        return np.clip(near, -self.increment, self.increment)

    def braking(self, last: Array) -> Array:
        """The next increment of a straight stop: the last one, shrunk as far as every joint allows."""
        needs = float(np.max(np.abs(last) / self.loss))
        return last * max(0.0, 1.0 - 1.0 / needs) if needs > 0.0 else last
