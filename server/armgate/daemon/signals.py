"""Named values that clients share with each other; the gate never reads them."""

from armgate.daemon.bucket import Bucket
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import MAX_SIGNALS, SignalValue


class Signals:
    """The newest value of every signal, one owner each.

    A signal belongs to the session that set it first, until that session ends; then it is gone.

    Args:
        rate: How many values a session may set per second on average.
        limit: How many signals there may be.
    """

    def __init__(self, rate: float, limit: int = MAX_SIGNALS) -> None:
        self._burst = max(rate, 1.0)
        self._rate = rate
        self._limit = limit
        self._owners: dict[str, str] = {}
        self._values: dict[str, SignalValue] = {}
        self._buckets: dict[str, Bucket] = {}

    def set(self, session: str, owner: str, name: str, value: tuple[float, ...], now: float) -> None:
        """Take a value over.

        Args:
            session: Id of the session that shares it.
            owner: Its name, as others shall see it.
            name: The signal.
            value: A scalar or a short vector.
            now: Daemon time, s.

        Raises:
            RemoteProtocolError: ``signal_rate``, ``signal_owned``, ``too_many_signals``; nothing has changed.
        """
        self._spend(session, now)
        if self._owners.get(name, session) != session:
            text = f"signal {name} belongs to {self._values[name].owner}; use another name"
            raise RemoteProtocolError(ErrorCode.SIGNAL_OWNED, text, about="signal")
        if name not in self._owners and len(self._owners) >= self._limit:
            text = f"there are {self._limit} signals already; share fewer"
            raise RemoteProtocolError(ErrorCode.TOO_MANY_SIGNALS, text, about="signal")
        self._owners[name] = session
        # A new dict, in the order of the names: states that were handed out do not change, and do not depend
        # on who came first.
        values = {**self._values, name: SignalValue(owner=owner, value=value, time=now)}
        self._values = dict(sorted(values.items()))

    def drop(self, session: str) -> None:
        """The session has ended: its signals are gone."""
        self._buckets.pop(session, None)
        gone = {name for name, owner in self._owners.items() if owner == session}
        if gone:
            self._owners = {name: owner for name, owner in self._owners.items() if name not in gone}
            self._values = {name: value for name, value in self._values.items() if name not in gone}

    @property
    def values(self) -> dict[str, SignalValue]:
        """All signals by name, ascending; not to be changed."""
        return self._values

    def _spend(self, session: str, now: float) -> None:
        bucket = self._buckets.get(session)
        if bucket is None:
            bucket = self._buckets[session] = Bucket(self._rate, self._burst, now)
        if not bucket.take(now):
            text = f"more than {self._rate:g} signals per second; this one was dropped"
            raise RemoteProtocolError(ErrorCode.SIGNAL_RATE, text, about="signal")
