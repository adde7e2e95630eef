"""Bounds of increments that the gate admits, for use by a controller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import floor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.weights import Vector

if TYPE_CHECKING:
    from armgate.cell.cell import Robot

# Relative margin to the bounds of the gate, which the gate computes from the same values.
SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class IncrementBounds:
    """Bounds on the increments of one robot, each (n,), rad or m.

    A straight stop brakes along the direction of the last increment: each increment is a smaller multiple of
    it. The quickest straight stop is the one that uses the whole allowed change of at least one joint.

    Attributes:
        step: largest |dq|.
        change: largest difference from the previous increment.
        lower: lower limit of the setpoint.
        upper: upper limit of the setpoint.
    """

    step: Vector
    change: Vector
    lower: Vector
    upper: Vector

    @classmethod
    def of(cls, robot: Robot) -> IncrementBounds:
        """Return the bounds of a cell's robot, as the gate applies them."""
        return cls.from_rates(
            lower=robot.lower,
            upper=robot.upper,
            velocity=robot.velocity,
            acceleration=robot.acceleration,
            deceleration=robot.deceleration,
            period=robot.period,
        )

    @classmethod
    def from_rates(
        cls,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        period: float,
        deceleration: ArrayLike | None = None,
        speed: float = 1.0,
        margin: float = 2e-4,
    ) -> IncrementBounds:
        """Return bounds from the rates in a robot's description.

        Args:
            lower: lower joint limits, rad or m.
            upper: upper joint limits.
            velocity: rad/s or m/s.
            acceleration: rad/s² or m/s².
            period: period of the robot's clock, s.
            deceleration: rad/s² or m/s²; None: unlimited for all joints; inf: unlimited for that joint. If a
                joint's deceleration is smaller than its acceleration, it also limits the acceleration, so
                that the robot can brake from every speed that it reaches.
            speed: share of the velocity that the lease allows.
            margin: distance kept from the joint limits, rad or m, because they also apply to the measured
                position.

        Raises:
            ValueError: if the arrays differ in length or a rate is not positive.
        """
        if deceleration is None:
            deceleration = np.full(np.shape(acceleration), np.inf)
        rows = (lower, upper, velocity, acceleration, deceleration)
        low, high, rate, gain, shed = (np.array(row, dtype=np.float64) for row in rows)
        if any(row.shape != low.shape or row.ndim != 1 for row in (low, high, rate, gain, shed)):
            raise ValueError("expected limits, velocity and accelerations of equal length")
        positive = all((row > 0.0).all() for row in (rate, gain, shed))
        if not (positive and period > 0.0 and 0.0 < speed <= 1.0):
            raise ValueError("expected a positive period, rates and accelerations, and a speed in (0, 1]")
        inside = 1.0 - SLACK
        return cls(
            step=rate * (inside * speed * period),
            change=np.minimum(gain, shed) * (inside * period * period),
            lower=low + margin,
            upper=high - margin,
        )

    def tightened(self, lower: Vector, upper: Vector) -> IncrementBounds:
        """Return the bounds with the setpoint also limited to `lower` and `upper`, (n,)."""
        return replace(self, lower=np.maximum(self.lower, lower), upper=np.minimum(self.upper, upper))

    def middle(self, share: float) -> tuple[Vector, Vector]:
        """Return the limits (n,) of a share of the range, in its middle."""
        middle, half = 0.5 * (self.upper + self.lower), 0.5 * (self.upper - self.lower)
        return middle - share * half, middle + share * half

    def braked(self, dq: Vector) -> Vector:
        """Return the first increment of the quickest straight stop after `dq`: a share of `dq`."""
        return dq * max(0.0, 1.0 - self._decay(dq))

    def stop(self, dq: Vector) -> float:
        """Return S: in the quickest straight stop after the increment `dq` the robot moves by S · dq."""
        decay = self._decay(dq)
        if decay >= 1.0:
            return 0.0
        ticks = floor(1.0 / decay)
        return ticks - 0.5 * decay * ticks * (ticks + 1)

    def _decay(self, dq: Vector) -> float:
        moving = np.abs(dq) > 1e-15
        return float((self.change[moving] / np.abs(dq[moving])).min()) if moving.any() else np.inf

    def admits(self, dq: Vector, setpoint: Vector) -> bool:
        """Return True if the increment and the stop after it stay within the joint limits."""
        way = (1.0 + self.stop(dq)) * dq
        ahead = np.where(dq > 0.0, self.upper - setpoint, setpoint - self.lower)
        return bool((np.abs(way) <= np.maximum(ahead, 0.0) + 1e-12).all())

    def box(self, wanted: Vector, last: Vector, setpoint: Vector) -> tuple[Vector, Vector]:
        """Return lower and upper bounds (n,) of the increment that follows `last` at `setpoint`.

        They combine the largest step and the room that the joint limits leave for the increment and the stop
        after it; the stop is that of an increment as long as `wanted`. If the allowed change from `last` is
        tighter, it takes precedence.
        """
        share = 1.0 / (1.0 + self.stop(wanted))
        down, up = np.minimum(self.lower - setpoint, 0.0), np.maximum(self.upper - setpoint, 0.0)
        least, most = last - self.change, last + self.change
        low: Vector = np.clip(np.maximum(-self.step, share * down), least, most)
        high: Vector = np.clip(np.minimum(self.step, share * up), least, most)
        return low, high

    def within(self, wanted: Vector, last: Vector, setpoint: Vector) -> Vector:
        """Return the increment nearest to `wanted` that may follow `last` at `setpoint`, (n,).

        Each joint is limited to the step, to the room that the limits leave with braking, and to the change
        that the acceleration allows. If the robot could then not stop within the limits, the increment is
        blended with the braking increment, after which it can.
        """
        low, high = self.box(np.clip(wanted, -self.step, self.step), last, setpoint)
        u: Vector = np.clip(wanted, low, high)
        return u if self.admits(u, setpoint) else self._blend(self.braked(last), u, setpoint)

    def _blend(self, safe: Vector, wanted: Vector, setpoint: Vector) -> Vector:
        low, high = 0.0, 1.0
        for _ in range(12):
            middle = 0.5 * (low + high)
            if self.admits(safe + middle * (wanted - safe), setpoint):
                low = middle
            else:
                high = middle
        blended: Vector = safe + low * (wanted - safe)
        return blended
