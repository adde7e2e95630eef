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
    """Decides in which role a client comes in.

    A right token is accepted however many wrong ones came from the same address: looking at a token always
    takes the same work.

    Args:
        tokens: The tokens that are accepted; None: everybody, in the role that the hello names.
        attempts: Counts the hellos that failed.
        log: Where failures are logged, without what was given.
    """

    def __init__(self, tokens: Tokens | None, attempts: Attempts, log: Log) -> None:
        self._tokens = tokens
        self._attempts = attempts
        self._log = log

    def admit(self, hello: Hello, origin: str, now: float) -> Admission:
        """Return the role granted to this client.

        Raises:
            RemoteProtocolError: ``unauthorized``.
        """
        if self._tokens is None:
            return Admission(hello.role)
        token = self._tokens.find(hello.token)
        if token is None or not token.allows(hello.role):
            self._note(hello, token, origin, now)
            raise RemoteProtocolError(ErrorCode.UNAUTHORIZED, _WRONG, about="hello")
        robots = None if token.robots is None else frozenset(token.robots)
        return Admission(hello.role, robots, token)

    def replace(self, tokens: Tokens) -> None:
        """Accept these tokens from now on."""
        self._tokens = tokens

    def _note(self, hello: Hello, token: Token | None, origin: str, now: float) -> None:
        unlogged = self._attempts.failed(origin, now)
        if unlogged is None:
            return
        why = "no token" if hello.token is None else "unknown token" if token is None else "role"
        name = None if token is None else token.name
        more = {"unlogged": unlogged} if unlogged else {}
        self._log.warning("login.failed", origin=origin, why=why, token=name, role=hello.role, **more)
