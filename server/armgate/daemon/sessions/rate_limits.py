"""Rate limits of reading: messages per second per client, per identity, per address, and in total.

An identity is a token, or the address of a client without one. Each message that is read counts in every
limit that applies to its client. A client that has used up a limit is not read for a while; none of its
messages is dropped. Holders of robots, and operators by token or user, count only in their own limit, so
that no other client can use it up.
"""

from collections.abc import Callable
from dataclasses import dataclass

from armgate.world.token_bucket import TokenBucket

_BURST = 0.25
"""Burst of a limit as a share of the messages that it allows in 1 s."""

_KEPT = 1024
"""Number of limits of identities and addresses above which the unused ones are removed."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Messages that are read per second on average."""

    client: float
    identity: float
    address: float
    in_all: float


class RateLimits:
    """Limits that clients share.

    Args:
        rates: The rates.
        now: Time of a clock that does not go back, s.

    Attributes:
        now: The same clock.
    """

    def __init__(self, rates: Rates, now: Callable[[], float]) -> None:
        self._rates = rates
        self.now = now
        self._all = self._bucket(rates.in_all)
        self._shared: dict[str, TokenBucket] = {}

    def own(self) -> TokenBucket:
        """Return the limit of a new client."""
        return self._bucket(self._rates.client)

    def shared(self, identity: str, address: str) -> tuple[TokenBucket, ...]:
        """Return the limits that a client of this identity at this address shares with other clients."""
        of_address = self._of(f"address {address}", self._rates.address)
        return (self._of(f"identity {identity}", self._rates.identity), of_address, self._all)

    def _of(self, key: str, rate: float) -> TokenBucket:
        bucket = self._shared.pop(key, None) or self._bucket(rate)
        self._shared[key] = bucket
        if len(self._shared) > _KEPT:
            self._forget()
        return bucket

    def _forget(self) -> None:
        now = self.now()
        self._shared = {key: bucket for key, bucket in self._shared.items() if not bucket.full(now)}

    def _bucket(self, rate: float) -> TokenBucket:
        return TokenBucket(rate, rate * _BURST, self.now())


class RateLimit:
    """Limits that apply to one client: its own, and those that it shares.

    Args:
        limits: Limits of all clients.
        address: Address that the client connects from; its identity until it has another one.
    """

    def __init__(self, limits: RateLimits, address: str) -> None:
        self._limits = limits
        self._address = address
        self._own = limits.own()
        self._shared = limits.shared(address, address)

    def identify(self, identity: str) -> None:
        """Count in the limit of this identity from now on."""
        self._shared = self._limits.shared(identity, self._address)

    def reserve(self, own_limit_only: bool) -> float:
        """Take one message; return the time to wait before it is read, s.

        Args:
            own_limit_only: True if the limits that it shares do not count.
        """
        now = self._limits.now()
        own = self._own.reserve(now)
        return own if own_limit_only else max(own, *(bucket.reserve(now) for bucket in self._shared))

    def spend(self, count: float, own_limit_only: bool) -> None:
        """Take the cost of reading beyond the one message that was reserved."""
        self._own.spend(count)
        if not own_limit_only:
            for bucket in self._shared:
                bucket.spend(count)
