"""What increment a robot really played last, from the setpoints that its ticks show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LastIncrement:
    """The increment per tick that led to the newest setpoint, refused and missed commands included."""

    def __init__(self) -> None:
        self._tick: int | None = None
        self._setpoint: Array = np.zeros(0)

    def update(self, tick: int, setpoint: Sequence[float]) -> Array:
        """Takes in the setpoint of a tick (n,); zeros at first, a mean where ticks were missed."""
        now = np.array(setpoint, dtype=float)
        last = np.zeros_like(now)
        if self._tick is not None and tick > self._tick:
            last = (now - self._setpoint) / (tick - self._tick)
        self._tick, self._setpoint = tick, now
        return last
