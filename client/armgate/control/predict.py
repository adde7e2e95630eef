"""Prediction of a point's position: an α-β-γ filter over its time-stamped positions."""

from __future__ import annotations

from math import expm1, isfinite

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.vectors import V3, vector
from armgate.control.weights import Vector


def ramp_lag(lag: float, period: float) -> float:
    """Return the delay, s, with which a first-order lag follows a ramp.

    The lag is q ← q + (1 − e^(−T/τ)) (q_ref − q) in each period T. The delay is T / (e^(T/τ) − 1), which is
    about τ − T/2; 0 without lag.

    Args:
        lag: time constant τ, s.
        period: T, s.
    """
    return 0.0 if lag <= 0.0 else period / expm1(period / lag)


ZERO: V3 = (0.0, 0.0, 0.0)


class Predictor:
    """Estimator and extrapolator of position, velocity and acceleration of a point.

    Let e be the difference of a new position from the position predicted for its time, and dt the time since
    the previous position. Then

        p ← p + α e,      v ← v + β e / dt,      a ← a + γ e / dt²

    (Kalata 1984; γ here is half of his γ). γ = 0 gives the α-β filter, which assumes a constant velocity.

    Args:
        alpha: share of the residual that goes into the position, (0, 1].
        beta: share that goes into the velocity.
        gamma: share that goes into the acceleration.
        gap: pause after which the filter restarts, s.
    """

    def __init__(self, alpha: float = 0.5, beta: float = 0.18, gamma: float = 0.02, gap: float = 0.2) -> None:
        if not (0.0 < alpha <= 1.0 and beta >= 0.0 and gamma >= 0.0):
            raise ValueError(f"expected 0 < alpha ≤ 1, beta ≥ 0, gamma ≥ 0; got {alpha}, {beta}, {gamma}")
        self._alpha, self._beta, self._gamma, self._gap = alpha, beta, gamma, gap
        self._time: float | None = None
        self._p = self._v = self._a = ZERO

    @property
    def time(self) -> float | None:
        """Time stamp of the newest position, s; None before the first."""
        return self._time

    @property
    def velocity(self) -> Vector:
        """Velocity at the newest position, m/s."""
        return np.array(self._v)

    def update(self, time: float, point: ArrayLike) -> None:
        """Add the point (3,), m, measured at `time`, s; ignored unless newer than the last.

        Raises:
            ValueError: if time or point is not finite or the point does not have three coordinates.
        """
        p = np.asarray(point, dtype=np.float64)
        if p.shape != (3,) or not all(map(isfinite, (time, *p.tolist()))):
            raise ValueError(f"expected a time and three finite coordinates, got {time} and {p}")
        if self._time is not None and time <= self._time:
            return
        if self._time is None or time - self._time > self._gap:
            self._time, self._p, self._v, self._a = time, vector(p.tolist()), ZERO, ZERO
            return
        dt = time - self._time
        expected, v = self._ahead(dt)
        e = vector([measured - x for measured, x in zip(p.tolist(), expected, strict=True)])
        self._time = time
        self._p = _moved(expected, self._alpha, e)
        self._v = _moved(v, self._beta / dt, e)
        self._a = _moved(self._a, self._gamma / (dt * dt), e)

    def predict(self, ahead: float) -> tuple[Vector, Vector]:
        """Return position (3,), m, and velocity (3,), m/s, `ahead` s after the newest position.

        Raises:
            ValueError: before the first position.
        """
        if self._time is None:
            raise ValueError("no position yet: call update first")
        position, velocity = self._ahead(ahead)
        return np.array(position), np.array(velocity)

    def _ahead(self, dt: float) -> tuple[V3, V3]:
        straight = _moved(self._p, dt, self._v)
        return _moved(straight, 0.5 * dt * dt, self._a), _moved(self._v, dt, self._a)


def _moved(p: V3, share: float, by: V3) -> V3:
    """Return p + share · by."""
    return p[0] + share * by[0], p[1] + share * by[1], p[2] + share * by[2]
