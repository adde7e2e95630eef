"""Roles of clients: by token, certificate, or user of the Unix socket; without those, by their hello."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import time

from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.tokens import RANKS, Token, Tokens
from armgate.daemon.sessions.connection_limits import Slot
from armgate.links.log import Log
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import Hello, Role

# One text for every reason: it must not reveal which part of a guess was correct.
_UNAUTHORIZED = (
    "this daemon requires a token that allows the requested role: use the token that was created for "
    "you, ask for a role that it allows, or create one with `armgate token`"
)


@dataclass(frozen=True, slots=True)
class Admission:
    """Rights that a client was granted.

    Attributes:
        role: Its role.
        robots: Robots that it may command; None: all.
        token: Its token; None without one.
    """

    role: Role
    robots: frozenset[str] | None = None
    token: Token | None = None


class Access:
    """Decision on the role of a client.

    A correct token is accepted even after many wrong ones from the same address: the work of checking a token
    is always the same.

    Args:
        tokens: Tokens that are accepted; None: every client is accepted, in the role that its hello names.
        users: Roles of this machine's users, for connections on the Unix socket without a token.
        wall: Unix time, s, which decides whether tokens have expired.
        failures: Counts the hellos that were refused, and bounds their log.
        log: Receives refused hellos, without the secrets given.
    """

    def __init__(
        self,
        tokens: Tokens | None,
        failures: FailureLog,
        log: Log,
        users: Mapping[int, Role] | None = None,
        wall: Callable[[], float] = time,
    ) -> None:
        self._wall = wall
        self._tokens = tokens
        self._users = users or {}
        self._failures = failures
        self._log = log

    def admit(self, hello: Hello, slot: Slot, now: float, certificate: bytes | None = None) -> Admission:
        """Return the rights granted to a client.

        Args:
            hello: Its hello.
            slot: Its address.
            now: Time of a monotonic clock, s.
            certificate: Certificate that it has shown over TLS, in DER; used if the hello has no token.

        Raises:
            RemoteProtocolError: ``unauthorized``.
        """
        if slot.uid is not None and (self._tokens is None or hello.token is None):
            return self._admit_user(hello, slot, slot.uid, now)
        if self._tokens is None:
            return Admission(hello.role)
        if hello.token is None and certificate is not None:
            token = self._tokens.of_certificate(certificate)
        else:
            token = self._tokens.find(hello.token)
        if token is None or not token.allows(hello.role) or token.expired(self._wall()):
            self._log_failure(hello, slot, now, _why(hello, token), None if token is None else token.name)
            raise RemoteProtocolError(ErrorCode.UNAUTHORIZED, _UNAUTHORIZED, about="hello")
        robots = None if token.robots is None else frozenset(token.robots)
        return Admission(hello.role, robots, token)

    def replace(self, tokens: Tokens) -> None:
        """Accept these tokens from now on."""
        self._tokens = tokens

    def _admit_user(self, hello: Hello, slot: Slot, uid: int, now: float) -> Admission:
        role = self._users.get(uid)
        if role is not None and RANKS[hello.role] <= RANKS[role]:
            return Admission(hello.role)
        self._log_failure(hello, slot, now, "unknown user" if role is None else "role", None)
        may = "is not listed" if role is None else f"may connect as {role} at most"
        text = f"user {uid} {may} (server.socket.users), and no token allows more"
        raise RemoteProtocolError(ErrorCode.UNAUTHORIZED, text, about="hello")

    def _log_failure(self, hello: Hello, slot: Slot, now: float, why: str, token: str | None) -> None:
        fields = {"why": why, "token": token, "role": hello.role}
        self._failures.note(self._log, "login.failed", slot.origin, now, **fields)


def _why(hello: Hello, token: Token | None) -> str:
    """Return the reason why a token was refused, for the log."""
    if token is not None:
        return "role" if not token.allows(hello.role) else "expired"
    return "no token" if hello.token is None else "unknown token"
