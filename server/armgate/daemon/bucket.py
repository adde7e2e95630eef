"""An allowance that time refills: what bounds rates."""


class Bucket:
    """So many at once, and so many per second on average.

    Args:
        rate: How fast it refills, per s.
        burst: How much it holds; it begins full.
        now: The time, s, of any clock that does not go back.
    """

    __slots__ = ("_burst", "_left", "_rate", "_time")

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._left = burst
        self._time = now

    def take(self, now: float) -> bool:
        """Take one, if there is one."""
        self._refill(now)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True

    def spend(self, count: int) -> None:
        """Take some, also where there are fewer: the next ones wait for it."""
        self._left -= count

    def wait(self, now: float) -> float:
        """How long until there is one, s; 0: there is."""
        self._refill(now)
        return max(0.0, (1.0 - self._left) / self._rate)

    def _refill(self, now: float) -> None:
        self._left = min(self._burst, self._left + (now - self._time) * self._rate)
        self._time = now
