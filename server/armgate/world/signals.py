"""Signals: named values that clients share with each other. The gate never reads them."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from armgate.cell.config import ServerConfig, SignalRuleConfig
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import MAX_SIGNALS, SignalValue
from armgate.protocol.unvalidated import unvalidated
from armgate.world.interfaces import Client
from armgate.world.token_bucket import TokenBucket

KEPT = 16
"""Number of places that are kept for names under a reserved prefix."""


@dataclass(frozen=True, slots=True)
class Reserved:
    """Clients that may set the signals under a prefix.

    Attributes:
        operator: True if only operators may set them.
        clients: Names of tokens, ``uid N`` for users on the Unix socket, or names of clients without a
            token or user; None: all.
    """

    operator: bool
    clients: frozenset[str] | None = None


class Signals:
    """Latest value of every signal; each signal has one owner.

    A signal belongs to the session that set it first. It is removed when that session ends.

    Args:
        rate: Values that a session may set per second on average.
        per_client: Largest number of signals of a client.
        reserved: Clients that may set the signals under a prefix; the longest matching prefix applies.
        limit: Largest number of signals of all clients.
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
        self._owners: dict[str, Client] = {}
        self._values: dict[str, SignalValue] = {}
        self._buckets: dict[str, TokenBucket] = {}

    def set(self, client: Client, name: str, value: tuple[float, ...], now: float) -> None:
        """Set a signal.

        Args:
            client: The client that sets it.
            name: Name of the signal, as in a valid message.
            value: A scalar or a short vector, as in a valid message.
            now: Daemon time, s.

        Raises:
            RemoteProtocolError: ``signal_rate``, ``forbidden``, ``signal_owned`` or ``too_many_signals``;
                no value has changed.
        """
        self._spend(client.id, now)
        owner = self._owners.get(name)
        if owner is None or owner.id != client.id:
            self._authorize(client, name)
            self._check_free(client, name)
            self._owners[name] = client
        # A new dict in the order of the names: states that were handed out do not change, and their order
        # does not depend on the order in which clients set signals.
        newest = unvalidated(SignalValue, {"owner": client.name, "value": value, "time": now})
        values = {**self._values, name: newest}
        self._values = values if owner is not None else dict(sorted(values.items()))

    def drop(self, session: str) -> None:
        """Remove the signals of a session that has ended."""
        self._buckets.pop(session, None)
        gone = {name for name, owner in self._owners.items() if owner.id == session}
        if gone:
            self._owners = {name: owner for name, owner in self._owners.items() if name not in gone}
            self._values = {name: value for name, value in self._values.items() if name not in gone}

    @property
    def values(self) -> dict[str, SignalValue]:
        """All signals by name, ascending; do not modify."""
        return self._values

    def _authorize(self, client: Client, name: str) -> None:
        found = self._rule(name)
        if found is None:
            return
        prefix, rule = found
        if rule.operator and client.role != "operator":
            text = f"signal {name}: names under {prefix} are for operators; connect as operator"
        elif rule.clients is not None and (client.known_as or client.name) not in rule.clients:
            text = f"signal {name}: names under {prefix} are for {', '.join(sorted(rule.clients))}"
        else:
            return
        raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about="signal")

    def _rule(self, name: str) -> tuple[str, Reserved] | None:
        return next(((prefix, rule) for prefix, rule in self._reserved if name.startswith(prefix)), None)

    def _check_free(self, client: Client, name: str) -> None:
        if name in self._owners:
            text = f"signal {name} belongs to {self._values[name].owner}; use another name"
            raise RemoteProtocolError(ErrorCode.SIGNAL_OWNED, text, about="signal")
        self._check_room(client, name)

    def _check_room(self, client: Client, name: str) -> None:
        own = Counter(_account(owner) for owner in self._owners.values())[_account(client)]
        free = sum(self._rule(other) is None for other in self._owners)
        if own >= self._per_client:
            text = f"you share {own} signals already, which is the limit for a client; share fewer signals"
        elif len(self._owners) >= self._limit:
            text = f"there are {self._limit} signals already; share fewer signals"
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
            text = f"more than {self._rate:g} signals per second; this one was dropped, send them less often"
            raise RemoteProtocolError(ErrorCode.SIGNAL_RATE, text, about="signal")


def signals_of(server: ServerConfig) -> Signals:
    """Return the signals of a daemon as it is configured; names under ``operator.`` are for operators."""
    rules = {"operator.": SignalRuleConfig(role="operator")} | server.signals
    reserved = {
        prefix: Reserved(rule.role == "operator", None if rule.clients is None else frozenset(rule.clients))
        for prefix, rule in rules.items()
    }
    return Signals(server.signal_rate, server.signals_per_client, reserved)


def _account(client: Client) -> str:
    """Return the account by which signals are counted: the client's token or user, else its session."""
    return f"session {client.id}" if client.known_as is None else f"client {client.known_as}"
