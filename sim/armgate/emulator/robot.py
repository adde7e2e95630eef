"""Emulated robot: its measured position follows the setpoint with a first-order lag."""

import math
from collections.abc import Sequence

from armgate.events import Joints


class EmulatedRobot:
    """Emulated arm with its drives, whose measured position lags behind the setpoint.

    Between two cycles the setpoint is held, so the lag has an exact solution (no integration step):

        q(k+1) = q(k) + (1 − exp(−T/τ)) · (setpoint(k) − q(k)),    τ = 0: q(k+1) = setpoint(k)

    Args:
        q0: Position at the first cycle, rad or m for each joint.
        period: Time T between two cycles, s.
        lag: Time constant τ, s, of all joints or of each joint; with 0 the robot follows without lag.

    Raises:
        ValueError: The period is not positive, a lag is negative, or there is not one for each joint.
    """

    def __init__(self, q0: Sequence[float], period: float, lag: float | Sequence[float]) -> None:
        if not period > 0.0:
            raise ValueError(f"period {period}: expected a time above 0 s")
        self._q: Joints = tuple(q0)
        lags = (lag,) * len(self._q) if isinstance(lag, float | int) else tuple(lag)
        if len(lags) != len(self._q):
            raise ValueError(f"{len(lags)} lags; expected one for each of {len(self._q)} joints")
        self._gains = tuple(_gain(period, one) for one in lags)

    @property
    def q(self) -> Joints:
        """Measured position at the present cycle."""
        return self._q

    def step(self, setpoint: Joints) -> Joints:
        """Advance by one period with the setpoint held; return the position at its end."""
        moves = zip(self._q, setpoint, self._gains, strict=True)
        self._q = tuple([s if gain == 1.0 else q + gain * (s - q) for q, s, gain in moves])
        return self._q


def _gain(period: float, lag: float) -> float:
    if not (lag >= 0.0 and math.isfinite(lag)):
        raise ValueError(f"lag {lag}: expected a time of 0 s or more")
    return 1.0 if lag == 0.0 else -math.expm1(-period / lag)
