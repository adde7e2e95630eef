"""Increment that a robot played last, from the setpoints of its ticks."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LastIncrement:
    """Increment per tick that led to the newest setpoint; it includes refused and missed commands."""

    def __init__(self) -> None:
        self._tick: int | None = None
        self._setpoint: Array = np.zeros(0)

    def update(self, tick: int, setpoint: Sequence[float] | Array) -> Array:
        """Return the last increment (n,) for a tick's setpoint: zeros at first, a mean after missed ticks."""
        now = np.array(setpoint, dtype=float)
        if self._tick is None or tick <= self._tick:
            last = np.zeros(len(now))
        else:
            last = (now - self._setpoint) / (tick - self._tick)
        self._tick, self._setpoint = tick, now
        return last
