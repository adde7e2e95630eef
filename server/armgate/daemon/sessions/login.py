"""Login: acceptance of clients, their roles, and the expiry of their tokens."""

import asyncio
from collections.abc import Callable, Iterable
from time import monotonic, time

from armgate.cell.config import ServerConfig
from armgate.daemon.auth.access import Access
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.reloading import warn_of_unknown_robots
from armgate.daemon.auth.tokens import Token, Tokens
from armgate.daemon.sessions.connection_limits import ConnectionLimits
from armgate.daemon.sessions.session import Session
from armgate.links.log import Log
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import Client

_REVOKED = "the token of this session was revoked or changed; connect with a valid one"
_EXPIRED = "the token of this session has expired; connect with a valid one"

_CHECK = 1.0
"""Time between two checks for expired tokens, s."""


class Login:
    """Login of clients; ends the sessions whose token expires, is revoked or changed.

    Args:
        settings: Bounds of failed logins.
        keys: Tokens, and roles of the users of this machine.
        limits: Counts the connections.
        session_id: Returns the id of a session from the name of its client and the number of its connection.
        robots: Names of the robots of the cell.
        log: Receives failed logins, without secrets.
    """

    def __init__(
        self,
        settings: ServerConfig,
        keys: Keys,
        limits: ConnectionLimits,
        session_id: Callable[[str, int], str],
        robots: Iterable[str],
        log: Log,
    ) -> None:
        failures = FailureLog(settings.login_failures, settings.login_failures_per_address, monotonic())
        self._access = Access(keys.tokens, failures, log, keys.users)
        self._limits = limits
        self._session_id = session_id
        self._robots = tuple(robots)
        self._log = log
        self._tokens: dict[Session, Token] = {}

    def admit(self, session: Session, hello: m.Hello) -> Client:
        """Return the client of a session whose hello is accepted.

        Raises:
            RemoteProtocolError: ``unauthorized`` or ``too_many``.
        """
        admitted = self._access.admit(hello, session.slot, monotonic(), session.certificate)
        token = admitted.token
        name = None if token is None else token.name
        if refusal := self._limits.admit(session.slot, admitted.role, name or ""):
            raise RemoteProtocolError(ErrorCode.TOO_MANY, refusal, about="hello")
        if token is not None:
            self._tokens[session] = token
        return Client(
            id=self._session_id(hello.name, session.number),
            name=hello.name,
            role=admitted.role,
            robots=admitted.robots,
            identity=session.slot.origin if name is None else f"token {name}",
            token=name,
            known_as=session.slot.origin if name is None and session.slot.uid is not None else name,
            address=session.address,
            capabilities=session.capabilities,
        )

    def closed(self, session: Session) -> None:
        """Forget the token of a session whose connection is closed."""
        self._tokens.pop(session, None)

    def use_tokens(self, tokens: Tokens) -> dict[str, object]:
        """Accept these tokens from now on; end sessions whose token is revoked or changed."""
        self._access.replace(tokens)
        warn_of_unknown_robots(tokens, self._robots, self._log)
        valid = {token.grant: token for token in tokens}
        for session, token in tuple(self._tokens.items()):
            renewed = valid.get(token.grant)
            if renewed is None:
                self._expel(session, _REVOKED)
            else:
                self._tokens[session] = renewed
        return {"names": [token.name for token in tokens]}

    def end_expired(self) -> None:
        """End the sessions whose token has expired, now and once a second."""
        now = time()
        for session, token in tuple(self._tokens.items()):
            if token.expired(now):
                self._expel(session, _EXPIRED)
        asyncio.get_running_loop().call_later(_CHECK, self.end_expired)

    def _expel(self, session: Session, text: str) -> None:
        self._tokens.pop(session, None)
        if session.greeted:
            session.expel(RemoteProtocolError(ErrorCode.UNAUTHORIZED, text))
