"""All connections of a daemon, from the listener to the last bye."""

import asyncio
import itertools
from collections.abc import Callable
from time import monotonic

from armgate.cell.config import ServerConfig
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.reloading import ReloadSource
from armgate.daemon.auth.tls import is_for_clients
from armgate.daemon.pace.pace import Pace
from armgate.daemon.sessions.connection_limits import ConnectionLimits, Slot
from armgate.daemon.sessions.listener import Listener
from armgate.daemon.sessions.login import Login
from armgate.daemon.sessions.rate_limits import RateLimit, RateLimits, Rates
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.daemon.sessions.session import Session
from armgate.links.log import Log
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.core import Core
from armgate.world.interfaces import RequestHandler
from armgate.world.welcome import Greeter

_CLOSE = 2.0
"""Time that sessions have to close when the daemon ends, s."""

_NOT_FOR_CLIENTS = (
    "your certificate is not for clients: its extended key usage does not name clientAuth; "
    "create a client certificate (docs/security.md)"
)


class SessionManager:
    """Manager of all sessions, from the connection to its end; their `SessionHost`.

    Args:
        settings: Configuration of the server.
        keys: Certificates and tokens.
        core: The core.
        pace: Makes time pass.
        requests: Answers the requests of clients: the core, or lock-step in front of it.
        scheduler: Gives the turns in which clients are read.
        greeter: Makes the welcomes.
        log: Receives logins and ends of sessions.
        failed: Called with an exception that a session has raised.
    """

    def __init__(
        self,
        settings: ServerConfig,
        keys: Keys,
        core: Core,
        pace: Pace,
        requests: RequestHandler,
        *,
        scheduler: FairScheduler,
        greeter: Greeter,
        log: Log,
        failed: Callable[[BaseException], None],
    ) -> None:
        limits = ConnectionLimits(settings.max_connections, settings.max_connections_per_address)
        self._settings = settings
        self._keys = keys
        self._holds_robot = core.leasing.holds
        self._handler = requests
        self._scheduler = scheduler
        self._greeter = greeter
        self._log = log
        self.failed = failed
        # Ordered, so that what clients receive does not depend on the addresses of objects.
        self._sessions: dict[Session, None] = {}
        self._numbers = itertools.count(1)
        self._refused = FailureLog(settings.login_failures, settings.login_failures_per_address, monotonic())
        self._login = Login(settings, keys, limits, pace.session_id, core.robots, log)
        self._listener = self._make_listener(limits)
        # In lock-step the clients set the pace themselves.
        self._rate_limits = None if pace.lockstep else _rate_limits(settings)
        self._accepting = self._serving = True
        self._ending = False
        self._empty = asyncio.Event()

    def _make_listener(self, limits: ConnectionLimits) -> Listener:
        return Listener(
            self._make_session,
            limits,
            rate=self._settings.connection_rate,
            tls=self._keys.tls,
            handshake=self._settings.handshake_timeout,
            log=self._log,
            refused=self._refused,
        )

    # --- for the daemon -----------------------------------------------------------------------------------

    async def listen(self) -> tuple[str, int]:
        """Listen; return host and port, or ``unix:PATH`` and 0 without TCP.

        Raises:
            OSError: The address cannot be listened on.
        """
        if self._keys.socket is not None:
            self._listener.open_local(self._keys.socket)
        if not self._keys.tcp:
            return f"unix:{self._keys.socket}", 0
        host = self._settings.host
        return host, await self._listener.open(host, self._settings.port)

    def start(self) -> None:
        """Begin to end sessions whose token expires."""
        self._login.end_expired()

    def reload_sources(self) -> list[ReloadSource] | None:
        """Return the files that SIGHUP reloads; None if SIGHUP ends the daemon, as is the default."""
        sources = []
        if self._keys.reread is not None:
            sources.append(ReloadSource("tokens", self._keys.reread, self._login.use_tokens))
        if self._keys.reread_tls is not None:
            sources.append(ReloadSource("certificates", self._keys.reread_tls, self._listener.use_tls))
        return sources if sources or self._keys.socket is not None else None

    def queues(self) -> dict[str, int]:
        """Return the number of connections, and the bytes that wait for clients that read slowly."""
        unread = [session.unread for session in tuple(self._sessions)]
        return {
            "sessions": len(unread),
            "unread_bytes": sum(unread),
            "unread_bytes_of_one": max(unread, default=0),
        }

    def refuse_hellos(self) -> None:
        """Accept no further hello; sessions continue."""
        self._accepting = False

    def stop_listening(self) -> None:
        """Accept no further connection; open connections stay."""
        self._listener.close()

    def close_all(self, last: m.Message) -> None:
        """Process no further request, and close every connection after a last message."""
        self.stop_serving()
        for session in tuple(self._sessions):
            session.close(last)

    def stop_serving(self) -> None:
        """Process no further hello or request."""
        self._accepting = self._serving = False

    async def close(self) -> None:
        """Close every connection after a bye, and wait until they are closed."""
        self._ending = True
        self.close_all(m.Bye(reason="the daemon has ended"))
        self._check_empty()
        try:
            await asyncio.wait_for(self._empty.wait(), _CLOSE)
        except TimeoutError:
            for session in tuple(self._sessions):
                session.abort()
            await self._empty.wait()

    # --- for sessions -------------------------------------------------------------------------------------

    @property
    def serving(self) -> bool:
        """True if requests of clients are processed."""
        return self._serving

    def opened(self, session: Session) -> None:
        """Register a connection: it may stay if there is room and its hello comes in time."""
        self._sessions[session] = None
        if session.slot.refusal:
            session.close(RemoteProtocolError(ErrorCode.TOO_MANY, session.slot.refusal).message())
        elif session.certificate is not None and not is_for_clients(session.certificate):
            self._log_refused("certificate.refused", session)
            session.close(RemoteProtocolError(ErrorCode.UNAUTHORIZED, _NOT_FOR_CLIENTS).message())
        else:
            seconds = self._settings.handshake_timeout
            text = f"no hello within {seconds:g} s; send hello right after connecting"
            session.allow(seconds, RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, text))

    def hello(self, session: Session, hello: m.Hello) -> None:
        """Welcome a client, or close its connection with an error."""
        try:
            if not self._accepting:
                raise RemoteProtocolError(ErrorCode.SHUTTING_DOWN, "the daemon is ending", about="hello")
            session.identify(self._login.admit(session, hello), self._handler)
            self._handler.join(session)
        except RemoteProtocolError as error:
            session.forget()
            error.re = hello.id
            if error.code is not ErrorCode.UNAUTHORIZED:  # an unauthorized hello is logged as login.failed
                self._log_refused("refused", session, name=hello.name, code=error.code)
            session.close(error.message())
            return
        session.stay()
        client = session.client
        session.send(self._greeter.welcome(client, hello, session.version))
        fields = {"session": client.id, "name": client.name, "role": client.role, "token": client.token}
        self._log.info("welcome", address=client.address, software=hello.software, **fields)

    def left(self, session: Session, reason: str) -> None:
        """Forget a session whose connection is lost or about to be closed."""
        if session.greeted:
            client = session.client
            self._log.info("gone", session=client.id, name=client.name, reason=reason)
            if self._serving:
                self._handler.leave(session)

    def closed(self, session: Session) -> None:
        """Forget a connection that is closed."""
        self._sessions.pop(session, None)
        self._login.closed(session)
        self._listener.left(session.slot)
        self._check_empty()

    def privileged(self, session: Session) -> bool:
        """Return True if the session holds a robot, or is an operator by token or user."""
        if not session.greeted:
            return False
        client = session.client
        operator = client.known_as is not None and client.role == "operator"
        return operator or self._holds_robot(client.id)

    # --- inside -------------------------------------------------------------------------------------------

    def _make_session(self, slot: Slot) -> Session:
        limit = None if self._rate_limits is None else RateLimit(self._rate_limits, slot.origin)
        return Session(
            self,
            next(self._numbers),
            slot,
            self._settings.send_buffer,
            self._scheduler,
            limit=limit,
            dialects=self._greeter.dialects,
        )

    def _log_refused(self, event: str, session: Session, **fields: object) -> None:
        """Log a connection that was never welcomed, unless too many were logged before."""
        origin = session.slot.origin
        self._refused.note(self._log, event, origin, monotonic(), session=session.number, **fields)

    def _check_empty(self) -> None:
        if self._ending and not self._sessions:
            self._empty.set()


def _rate_limits(settings: ServerConfig) -> RateLimits:
    rates = Rates(
        client=settings.message_rate,
        identity=settings.message_rate_per_identity,
        address=settings.message_rate_per_address,
        in_all=settings.message_rate_in_all,
    )
    return RateLimits(rates, monotonic)
