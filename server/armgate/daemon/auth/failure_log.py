"""Log of failed logins and refused connections, bounded per origin and in all.

A token cannot be guessed (2^256 values), so failures block nothing: a correct token is accepted after any
number of failures from its address. Failures only add lines to the log, and these are bounded here.
"""

from collections import OrderedDict

from armgate.links.log import Log
from armgate.world.token_bucket import TokenBucket

_REMEMBERED = 1024
"""Number of origins that are remembered; the one whose last failure is oldest is forgotten first."""

_MINUTE = 60.0


class FailureLog:
    """Counter of failures, which logs some of them.

    Args:
        in_all: Failures that are logged per minute in total: average rate, and largest burst.
        per_origin: The same bound for each origin.
        now: Time of a monotonic clock, s.
    """

    def __init__(self, in_all: float, per_origin: float, now: float) -> None:
        self._per_origin = per_origin
        self._all = TokenBucket(in_all / _MINUTE, in_all, now)
        self._failing: OrderedDict[str, TokenBucket] = OrderedDict()
        self._unlogged = 0

    def failed(self, origin: str, now: float) -> int | None:
        """Count a failure, and decide if it is logged.

        Returns:
            Number of failures since the last logged one; None if this failure must not be logged.
        """
        bucket = self._failing.pop(origin, None) or self._new_bucket(now)
        self._failing[origin] = bucket
        while len(self._failing) > _REMEMBERED:
            self._failing.popitem(last=False)
        if bucket.take(now) and self._all.take(now):
            unlogged, self._unlogged = self._unlogged, 0
            return unlogged
        self._unlogged += 1
        return None

    def note(self, log: Log, event: str, origin: str, now: float, **fields: object) -> None:
        """Count a failure, and log it as a warning unless too many were logged before."""
        unlogged = self.failed(origin, now)
        if unlogged is not None:
            more = {"unlogged": unlogged} if unlogged else {}
            log.warning(event, origin=origin, **fields, **more)

    def _new_bucket(self, now: float) -> TokenBucket:
        return TokenBucket(self._per_origin / _MINUTE, self._per_origin, now)
