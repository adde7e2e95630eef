"""Turns at a steady rate, of which those that are missed altogether are left out."""

from collections.abc import Callable
from time import monotonic


class FrameTimer:
    """Says how long to wait for the next turn, so that in the mean the rate is kept.

    Args:
        rate: Turns per s.
        now: A clock that does not go back, s.
    """

    def __init__(self, rate: float, now: Callable[[], float] = monotonic) -> None:
        self._period, self._now = 1.0 / rate, now
        self._due = now()

    def remaining(self) -> float:
        """Time to the next turn, s; none where it is late."""
        now = self._now()
        self._due = max(self._due + self._period, now - self._period)
        return max(0.0, self._due - now)
