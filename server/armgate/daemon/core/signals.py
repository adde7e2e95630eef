"""Named values that clients share with each other; the gate never reads them."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from armgate.daemon.token_bucket import TokenBucket
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import MAX_SIGNALS, Role, SignalValue

KEPT = 16
"""Places of the table that are kept for names under a reserved prefix."""


@dataclass(frozen=True, slots=True)
class Reserved:
    """Clients that may set the signals under a prefix.

    Attributes:
        operator: True if only operators may.
        clients: Names of tokens, or ``uid N`` for users on the Unix socket; names of clients that have
            neither. None: all.
    """

    operator: bool
    clients: frozenset[str] | None = None


@dataclass(frozen=True, slots=True)
class Sharer:
    """A client that shares signals.

    Attributes:
        session: Id of its session, which owns what it sets.
        name: Its name, as states show it.
        role: Its role.
        known_as: Name of its token, or ``uid N`` on the Unix socket; None if the daemon only knows its name.
    """

    session: str
    name: str
    role: Role
    known_as: str | None = None

    @property
    def account(self) -> str:
        """What its signals count for: all sessions of a token or a user together, else this session."""
        return f"session {self.session}" if self.known_as is None else f"client {self.known_as}"


class Signals:
    """The newest value of every signal, one owner each.

    A signal belongs to the session that set it first, until that session ends; then it is gone.

    Args:
        rate: How many values a session may set per second on average.
        per_client: How many signals a client may have.
        reserved: Who may set the signals under a prefix; the longest prefix of a name counts.
        limit: How many signals there may be.
    """

    def __init__(
        self,
        rate: float,
        per_client: int = MAX_SIGNALS,
        reserved: Mapping[str, Reserved] | None = None,
        limit: int = MAX_SIGNALS,
    ) -> None:
        self._burst = max(rate, 1.0)
        self._rate = rate
        self._per_client = per_client
        self._limit = limit
        self._reserved = sorted((reserved or {}).items(), key=lambda item: -len(item[0]))
        self._owners: dict[str, Sharer] = {}
        self._values: dict[str, SignalValue] = {}
        self._buckets: dict[str, TokenBucket] = {}

    def set(self, sharer: Sharer, name: str, value: tuple[float, ...], now: float) -> None:
        """Take a value over.

        Args:
            sharer: The client that shares it.
            name: The signal.
            value: A scalar or a short vector.
            now: Daemon time, s.

        Raises:
            RemoteProtocolError: ``signal_rate``, ``forbidden``, ``signal_owned`` or ``too_many_signals``;
                nothing has changed.
        """
        self._spend(sharer.session, now)
        self._authorize(sharer, name)
        owner = self._owners.get(name)
        if owner is None:
            self._check_room(sharer, name)
        elif owner.session != sharer.session:
            text = f"signal {name} belongs to {self._values[name].owner}; use another name"
            raise RemoteProtocolError(ErrorCode.SIGNAL_OWNED, text, about="signal")
        self._owners[name] = sharer
        # A new dict, in the order of the names: states that were handed out do not change, and do not depend
        # on who came first.
        values = {**self._values, name: SignalValue(owner=sharer.name, value=value, time=now)}
        self._values = dict(sorted(values.items()))

    def drop(self, session: str) -> None:
        """Remove the signals of a session that has ended."""
        self._buckets.pop(session, None)
        gone = {name for name, owner in self._owners.items() if owner.session == session}
        if gone:
            self._owners = {name: owner for name, owner in self._owners.items() if name not in gone}
            self._values = {name: value for name, value in self._values.items() if name not in gone}

    @property
    def values(self) -> dict[str, SignalValue]:
        """All signals by name, ascending; not to be changed."""
        return self._values

    def _authorize(self, sharer: Sharer, name: str) -> None:
        found = self._rule(name)
        if found is None:
            return
        prefix, rule = found
        if rule.operator and sharer.role != "operator":
            text = f"signal {name}: names under {prefix} are for operators; connect as operator"
        elif rule.clients is not None and (sharer.known_as or sharer.name) not in rule.clients:
            text = f"signal {name}: names under {prefix} are for {', '.join(sorted(rule.clients))}"
        else:
            return
        raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about="signal")

    def _rule(self, name: str) -> tuple[str, Reserved] | None:
        return next(((prefix, rule) for prefix, rule in self._reserved if name.startswith(prefix)), None)

    def _check_room(self, sharer: Sharer, name: str) -> None:
        own = Counter(owner.account for owner in self._owners.values())[sharer.account]
        free = sum(self._rule(other) is None for other in self._owners)
        if own >= self._per_client:
            text = f"you share {own} signals already, and a client may share no more; share fewer"
        elif len(self._owners) >= self._limit:
            text = f"there are {self._limit} signals already; share fewer"
        elif self._reserved and self._rule(name) is None and free >= self._limit - KEPT:
            text = f"there are {free} signals already; the other {KEPT} places are for reserved names"
        else:
            return
        raise RemoteProtocolError(ErrorCode.TOO_MANY_SIGNALS, text, about="signal")

    def _spend(self, session: str, now: float) -> None:
        bucket = self._buckets.get(session)
        if bucket is None:
            bucket = self._buckets[session] = TokenBucket(self._rate, self._burst, now)
        if not bucket.take(now):
            text = f"more than {self._rate:g} signals per second; this one was dropped"
            raise RemoteProtocolError(ErrorCode.SIGNAL_RATE, text, about="signal")
