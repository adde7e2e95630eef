"""Robot server: runs the robots' links and holds their plans, independently of the daemon.

A link answers its robot first. The daemon is informed afterwards, and the server never waits for it. Messages
that the daemon does not read are buffered up to a bound. Beyond it, or after the timeout, the connection is
closed: every robot then plays its plan to the end and rests.
"""

import asyncio
import signal
import socket
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Protocol, assert_never

from armgate.events import LinkChange, Plan, PlanAnswer, Rebase
from armgate.links.robot_server.codec import CodecError, encode
from armgate.links.robot_server.connection import Connection
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.robot_server.messages import (
    FORMAT,
    Heartbeat,
    Hello,
    Message,
    Refusal,
    TickReport,
    ToDaemon,
    Welcome,
)

BACKLOG = 1 << 18
"""Bytes that a daemon may leave unread: a few seconds of ticks."""

_REST_CHECK = 0.05
"""Time between two checks whether the robots rest, s."""


class Log(Protocol):
    """Log of events."""

    def info(self, event: str, **fields: object) -> None:
        """Log a normal event."""

    def warning(self, event: str, **fields: object) -> None:
        """Log an event that needs attention."""


class RobotServer:
    """Server that lets one daemon at a time use its robots.

    Args:
        cell: Hash of the cell.
        links: The robots' links, in the order of the configuration.
        log: Log of events.
        now: Clock of timeouts, s.
    """

    def __init__(
        self, cell: str, links: Sequence[HostedLink], log: Log, now: Callable[[], float] = monotonic
    ) -> None:
        self._cell = cell
        self._links = {link.robot: link for link in links}
        self._log = log
        self.now = now
        self._daemon: ServerConnection | None = None
        self._connections: set[ServerConnection] = set()
        self._ending = False
        self._ended = asyncio.Event()

    async def run(self, listening: socket.socket, announce: Callable[[], None]) -> int:
        """Serve until SIGTERM or SIGINT; then wait until the robots rest.

        Returns:
            Exit status: 0, or 1 if a second signal ended it before the robots rested.

        Raises:
            OSError: A link cannot be opened.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.end)
        try:
            for link in self._links.values():
                await link.open()
            server = await loop.create_unix_server(lambda: ServerConnection(self), sock=listening)
            announce()
            await self._ended.wait()
            server.close()
        finally:
            for link in self._links.values():
                link.close()
            for connection in tuple(self._connections):
                connection.abort()
        self._log.info("ended", resting=self.resting)
        return 0 if self.resting else 1

    @property
    def resting(self) -> bool:
        """True if no robot has an increment left to play."""
        return all(link.resting for link in self._links.values())

    def end(self) -> None:
        """Accept no further plan, wait until the robots rest, then end; end at once at the second call."""
        if self._ending:
            self._ended.set()
            return
        self._ending = True
        self._log.info("end")
        for link in self._links.values():
            link.disarm()
        self._end_at_rest()

    def _end_at_rest(self) -> None:
        if self.resting:
            self._ended.set()
        else:
            asyncio.get_running_loop().call_later(_REST_CHECK, self._end_at_rest)

    def _log_rest(self) -> None:
        """Log that the plans have been played: without a daemon nothing else reports it."""
        if self.resting:
            self._log.info("at_rest")
        elif self._daemon is None:
            asyncio.get_running_loop().call_later(_REST_CHECK, self._log_rest)

    # --- connections --------------------------------------------------------------------------------------

    def opened(self, connection: "ServerConnection") -> None:
        """Register a new connection."""
        self._connections.add(connection)

    def receive(self, connection: "ServerConnection", message: Message) -> None:
        """Handle one message.

        Raises:
            CodecError: The client must not send it now.
        """
        if isinstance(message, Hello) and not connection.established:
            self._greet(connection, message)
        elif connection is not self._daemon:
            raise CodecError(f"{type(message).__name__} before hello")
        else:
            self._handle(message)

    def closed(self, connection: "ServerConnection", reason: str) -> None:
        """Forget a connection; if it was the daemon's, its robots play their plans to the end."""
        self._connections.discard(connection)
        if connection is self._daemon:
            self._daemon = None
            for link in self._links.values():
                link.detach()
            self._log.warning("daemon.gone", reason=reason, resting=self.resting)
            if not self._ending:
                self._log_rest()

    def _greet(self, connection: "ServerConnection", hello: Hello) -> None:
        connection.greet(hello.start)
        objection = self._objection(hello)
        if objection:
            self._log.warning("daemon.refused", start=hello.start, reason=objection)
            connection.refuse(objection)
            return
        self._daemon = connection
        connection.send(Welcome(FORMAT))
        for resume in hello.robots:
            self._links[resume.robot].attach(hello.start, resume, connection.send)
        self._log.info("daemon", start=hello.start)

    def _objection(self, hello: Hello) -> str:
        """Return the reason to refuse a daemon, "" if there is none."""
        if self._ending:
            return "the robot server is ending"
        if hello.cell != self._cell or [resume.robot for resume in hello.robots] != list(self._links):
            return (
                "the robot server was started with another configuration (hash "
                f"{self._cell[:12]}, the daemon's is {hello.cell[:12]}): start both with the same files"
            )
        if self._daemon is not None:
            return f"the daemon with start id {self._daemon.start} holds the robots: end it first"
        return ""

    def _handle(self, message: Message) -> None:
        match message:
            case Plan():
                self._link(message.robot).offer(message)
            case Rebase():
                self._log.info("rebase", robot=message.robot, resets=message.resets)
                self._link(message.robot).rebase(message)
            case Heartbeat():
                pass
            case Hello() | Welcome() | Refusal() | TickReport() | LinkChange() | PlanAnswer():
                raise CodecError(f"a daemon must not send {type(message).__name__} now")
            case _:
                assert_never(message)

    def _link(self, robot: str) -> HostedLink:
        if robot not in self._links:
            raise CodecError(f"no robot {robot}")
        return self._links[robot]


class ServerConnection(Connection):
    """The robot server's end of one connection.

    Attributes:
        start: Start id of the daemon, "" before its hello.
    """

    def __init__(self, server: RobotServer) -> None:
        super().__init__(server.now)
        self._server = server
        self._closed = False
        self._greeted = False
        self.start = ""

    @property
    def established(self) -> bool:
        """True once the client has sent hello."""
        return self._greeted

    def greet(self, start: str) -> None:
        """Note the hello of the daemon with this start id."""
        self._greeted, self.start = True, start

    def send(self, message: ToDaemon) -> None:
        """Send a message; close the connection if too much is left unread."""
        if self._closed:
            return
        self._transport.write(encode(message))
        if self._transport.get_write_buffer_size() > BACKLOG:
            self._stalled(f"stalled: more than {BACKLOG} bytes are unread")

    def refuse(self, reason: str) -> None:
        """Send a refusal and close."""
        self.send(Refusal(reason))
        self._close(reason)
        self._transport.close()

    def abort(self) -> None:
        """Close at once."""
        self._close("the robot server has ended")
        super().abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register with the server."""
        self._server.opened(self)
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Unregister from the server."""
        self._close("connection lost" if exc is None else str(exc))

    def _receive(self, message: Message) -> None:
        if not self._closed:
            self._server.receive(self, message)

    _reject = refuse

    def _stalled(self, reason: str) -> None:
        self._close(reason)
        self._transport.abort()

    def _close(self, reason: str) -> None:
        if not self._closed:
            self._closed = True
            self._stop_timer()
            self._server.closed(self, reason)
