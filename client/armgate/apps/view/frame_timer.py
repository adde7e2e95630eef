"""Timing of a drawing loop: a steady rate, with frames left out if the loop is late."""

from collections.abc import Callable
from time import monotonic


class FrameTimer:
    """Timer of a drawing loop that keeps the mean rate of frames.

    Args:
        rate: Frames per s.
        now: Monotonic clock, s.
    """

    def __init__(self, rate: float, now: Callable[[], float] = monotonic) -> None:
        self._period, self._now = 1.0 / rate, now
        self._due = now()

    def remaining(self) -> float:
        """Advance to the next frame, and return the time until it is due, s; 0 if it is late."""
        now = self._now()
        self._due = max(self._due + self._period, now - self._period)
        return max(0.0, self._due - now)
