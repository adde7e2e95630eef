"""Timing of a drawing loop: a steady rate, with frames left out if the loop is late."""

from collections.abc import Callable
from time import monotonic


class FrameTimer:
    """Time to the next frame, so that the mean rate is kept.

    Args:
        rate: Frames per s.
        now: Monotonic clock, s.
    """

    def __init__(self, rate: float, now: Callable[[], float] = monotonic) -> None:
        self._period, self._now = 1.0 / rate, now
        self._due = now()

    def remaining(self) -> float:
        """Return the time to the next frame, s; 0 if it is late."""
        now = self._now()
        self._due = max(self._due + self._period, now - self._period)
        return max(0.0, self._due - now)
