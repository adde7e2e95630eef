"""Who may come in, and as what: by token where there are tokens, else as it says."""

import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import time

from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.tokens import RANKS, Token, Tokens
from armgate.daemon.sessions.connection_limits import Slot
from armgate.links.log import Log
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
        users: Roles of the users of this machine by their id, on the Unix socket.
        socket: Where the Unix socket is, None for none.
        tokens: Who may come in.
        reread: Gives the tokens as their file says now; None: those from the start stay.
        reread_tls: Gives ``tls`` with the certificates that the files hold now; None: the first ones stay.
    """

    tls: ssl.SSLContext | None = None
    tokens: Tokens | None = None
    reread: Callable[[], Tokens] | None = None
    users: Mapping[int, Role] = field(default_factory=dict)
    socket: Path | None = None
    reread_tls: Callable[[], ssl.SSLContext] | None = None

    @property
    def tcp(self) -> bool:
        """True if the daemon listens on TCP: not if only the Unix socket tells clients apart."""
        return self.socket is None or self.tokens is not None


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
        users: Roles of this machine's users, for connections on the Unix socket that bring no token.
        wall: The Unix time, s, at which tokens expire.
        attempts: Counts the hellos that failed.
        log: Where failures are logged, without what was given.
    """

    def __init__(
        self,
        tokens: Tokens | None,
        attempts: FailureLog,
        log: Log,
        users: Mapping[int, Role] | None = None,
        wall: Callable[[], float] = time,
    ) -> None:
        self._wall = wall
        self._tokens = tokens
        self._users = users or {}
        self._attempts = attempts
        self._log = log

    def admit(self, hello: Hello, guest: Slot, now: float, certificate: bytes | None = None) -> Admission:
        """Return the role granted to this client.

        Args:
            hello: Its hello.
            guest: Where it connects from.
            now: The time, s, of a clock that does not go back.
            certificate: What it showed over TLS, in DER; counts if the hello brings no token.

        Raises:
            RemoteProtocolError: ``unauthorized``.
        """
        if guest.uid is not None and (self._tokens is None or hello.token is None):
            return self._admit_user(hello, guest, guest.uid, now)
        if self._tokens is None:
            return Admission(hello.role)
        if hello.token is None and certificate is not None:
            token = self._tokens.of_certificate(certificate)
        else:
            token = self._tokens.find(hello.token)
        if token is None or not token.allows(hello.role) or token.expired(self._wall()):
            why = "no token" if hello.token is None else "unknown token"
            if token is not None:
                why = "role" if not token.allows(hello.role) else "expired"
            self._note(hello, guest, now, why, None if token is None else token.name)
            raise RemoteProtocolError(ErrorCode.UNAUTHORIZED, _WRONG, about="hello")
        robots = None if token.robots is None else frozenset(token.robots)
        return Admission(hello.role, robots, token)

    def replace(self, tokens: Tokens) -> None:
        """Accept these tokens from now on."""
        self._tokens = tokens

    def _admit_user(self, hello: Hello, guest: Slot, uid: int, now: float) -> Admission:
        role = self._users.get(uid)
        if role is not None and RANKS[hello.role] <= RANKS[role]:
            return Admission(hello.role)
        self._note(hello, guest, now, "unknown user" if role is None else "role", None)
        may = "is not listed" if role is None else f"may come in as {role} at most"
        text = f"user {uid} {may} (server.socket.users), and no token allows more"
        raise RemoteProtocolError(ErrorCode.UNAUTHORIZED, text, about="hello")

    def _note(self, hello: Hello, guest: Slot, now: float, why: str, token: str | None) -> None:
        fields = {"why": why, "token": token, "role": hello.role}
        self._attempts.note(self._log, "login.failed", guest.origin, now, **fields)
