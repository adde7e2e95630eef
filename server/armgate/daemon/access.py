"""Who may come in, and as what: by token where there are tokens, else as it says."""

import ssl
from collections.abc import Callable
from dataclasses import dataclass

from armgate.daemon.attempts import Attempts
from armgate.daemon.log import Log
from armgate.daemon.tokens import Token, Tokens
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import Hello, Role

# One text for every reason: it must not tell which part of a guess was right.
_WRONG = (
    "this daemon asks for a token that allows what the hello asks for: give the one that was made for you, "
    "ask for a role that it has, or have one made with `armgate token`"
)


@dataclass(frozen=True, slots=True)
class Keys:
    """What connections are encrypted with, and who may come in; None: not encrypted, everybody.

    Attributes:
        tls: Encrypts connections.
        tokens: Who may come in.
        reread: Gives the tokens as their file says now; None: those from the start stay.
    """

    tls: ssl.SSLContext | None = None
    tokens: Tokens | None = None
    reread: Callable[[], Tokens] | None = None


@dataclass(frozen=True, slots=True)
class Admission:
    """As what a client came in.

    Attributes:
        role: Its role.
        robots: The robots that it may command, None: all.
        token: By which token, None: there are no tokens.
    """

    role: Role
    robots: frozenset[str] | None = None
    token: Token | None = None


class Access:
    """The door.

    Args:
        tokens: Who may come in; None: everybody, as what they say they are.
        attempts: Counts those that failed.
        log: Where failures are told, without what was given.
    """

    def __init__(self, tokens: Tokens | None, attempts: Attempts, log: Log) -> None:
        self._tokens = tokens
        self._attempts = attempts
        self._log = log

    def admit(self, hello: Hello, origin: str, now: float) -> Admission:
        """As what this client may come in.

        Raises:
            RemoteProtocolError: ``unauthorized``.
        """
        if self._tokens is None:
            return Admission(hello.role)
        if wait := self._attempts.wait(origin, now):
            self._log.warning("login.held", origin=origin, wait=round(wait, 1))
            raise _unauthorized(f"too many wrong tokens; none is looked at now: try again in {wait:.0f} s")
        token = self._tokens.find(hello.token)
        if token is None or not token.allows(hello.role):
            self._attempts.failed(origin, now)
            self._tell(hello, token, origin)
            raise _unauthorized(_WRONG)
        self._attempts.succeeded(origin)
        robots = None if token.robots is None else frozenset(token.robots)
        return Admission(hello.role, robots, token)

    def replace(self, tokens: Tokens) -> None:
        """From now on these count."""
        self._tokens = tokens

    def _tell(self, hello: Hello, token: Token | None, origin: str) -> None:
        why = "no token" if hello.token is None else "unknown token" if token is None else "role"
        name = None if token is None else token.name
        self._log.warning("login.failed", origin=origin, why=why, token=name, role=hello.role)


def _unauthorized(text: str) -> RemoteProtocolError:
    return RemoteProtocolError(ErrorCode.UNAUTHORIZED, text, about="hello")
