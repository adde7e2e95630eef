"""How often a wrong token may be tried, from one address and in all."""

from collections import OrderedDict
from typing import TypeVar

from armgate.daemon.bucket import Bucket

V = TypeVar("V")

_REMEMBERED = 1024
_MINUTE = 60.0


class Attempts:
    """Counts failures.

    One that fails too often is not heard for a while, whatever it brings. Too many failures in all close the
    door to everybody but the addresses that a right token came from: else many guessers together could lock
    the owners out.

    Args:
        in_all: Failures per minute on average, and at once.
        per_origin: The same for one origin.
        now: The time, s, of any clock that does not go back.
    """

    def __init__(self, in_all: float, per_origin: float, now: float) -> None:
        self._per_origin = per_origin
        self._all = Bucket(in_all / _MINUTE, in_all, now)
        self._failing: OrderedDict[str, Bucket] = OrderedDict()
        self._trusted: OrderedDict[str, None] = OrderedDict()

    def wait(self, origin: str, now: float) -> float:
        """How long this origin is not heard, s; 0: it is."""
        bucket = self._failing.get(origin)
        own = 0.0 if bucket is None else bucket.wait(now)
        return own if origin in self._trusted else max(own, self._all.wait(now))

    def failed(self, origin: str, now: float) -> None:
        """A wrong token came from there."""
        self._all.take(now)
        bucket = self._failing.pop(origin, None) or Bucket(self._per_origin / _MINUTE, self._per_origin, now)
        bucket.take(now)
        _remember(self._failing, origin, bucket)

    def succeeded(self, origin: str) -> None:
        """A right token came from there."""
        _remember(self._trusted, origin, None)


def _remember(known: OrderedDict[str, V], origin: str, value: V) -> None:
    """Keep what was seen last; who was seen long ago is forgotten."""
    known[origin] = value
    known.move_to_end(origin)
    while len(known) > _REMEMBERED:
        known.popitem(last=False)
