"""Token bucket: a bound on rates. Its tokens are not the tokens of clients."""


class TokenBucket:
    """Bound that allows a burst, and a rate on average.

    The bucket holds tokens, up to ``burst``; it gains ``rate`` tokens per second, and each event takes one.

    Args:
        rate: Tokens gained per second.
        burst: Largest number of tokens; the bucket begins full.
        now: Time of a clock that does not go back, s.
    """

    __slots__ = ("_burst", "_left", "_rate", "_time")

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._left = burst
        self._time = now

    def take(self, now: float) -> bool:
        """Take one token; return False if there is none."""
        self._refill(now)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True

    def reserve(self, now: float) -> float:
        """Take one token, even if there is none; return the time until the bucket has gained it, s.

        Waits add up, so clients that share a bucket are served in sequence.
        """
        self._refill(now)
        self._left -= 1.0
        return max(0.0, -self._left / self._rate)

    def spend(self, count: float) -> None:
        """Take tokens even if there are fewer: later events wait for them."""
        self._left -= count

    def wait(self, now: float) -> float:
        """Return the time until there is a token, s; 0 if there is one now."""
        self._refill(now)
        return max(0.0, (1.0 - self._left) / self._rate)

    def full(self, now: float) -> bool:
        """Return True if the bucket is full, like a new one."""
        self._refill(now)
        return self._left >= self._burst

    def _refill(self, now: float) -> None:
        self._left = min(self._burst, self._left + (now - self._time) * self._rate)
        self._time = now
