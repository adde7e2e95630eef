"""Token bucket: an allowance that time refills. It bounds rates."""


class TokenBucket:
    """Allow a burst at once, and a rate on average.

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
        """Take one if there is one."""
        self._refill(now)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True

    def reserve(self, now: float) -> float:
        """Take one in any case; return how long to wait until it is there, s.

        Waits add up, so many clients that share a bucket are served one after the other.
        """
        self._refill(now)
        self._left -= 1.0
        return max(0.0, -self._left / self._rate)

    def spend(self, count: float) -> None:
        """Take some, also if there are fewer: the next ones wait for it."""
        self._left -= count

    def wait(self, now: float) -> float:
        """Return how long until there is one, s; 0 if there is one now."""
        self._refill(now)
        return max(0.0, (1.0 - self._left) / self._rate)

    def full(self, now: float) -> bool:
        """Return True if nothing of the burst is used: a new bucket would do the same."""
        self._refill(now)
        return self._left >= self._burst

    def _refill(self, now: float) -> None:
        self._left = min(self._burst, self._left + (now - self._time) * self._rate)
        self._time = now
