"""The robot server: holds the robots' links and plans, whatever becomes of the daemon.

Links answer their robots by themselves; only then is the daemon told, and never waited for: bytes that it
does not read are kept up to a bound, beyond which, or when it is silent for too long, it is let go of. Then
every robot plays its plan to the end and rests.
"""

import asyncio
import signal
import socket
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Protocol

from armgate.events import Plan, Rebase
from armgate.links.robot_server.codec import CodecError, Decoder, encode
from armgate.links.robot_server.heartbeat import BEAT, Liveness
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.robot_server.messages import FORMAT, Beat, Hello, Message, Refusal, Up, Welcome

BACKLOG = 1 << 18
"""Bytes that a daemon may leave unread: some seconds of ticks."""

_LOOK = 0.05
"""Time between two looks at whether the robots rest, s, at the end."""


class Log(Protocol):
    """Where events are told."""

    def info(self, event: str, **fields: object) -> None:
        """Something happened as it should."""

    def warning(self, event: str, **fields: object) -> None:
        """Something that somebody should look at."""


class RobotServer:
    """Holds links, and gives them to one daemon at a time.

    Args:
        cell: The cell's hash.
        berths: The robots, in the order of the configuration.
        log: Where events are told.
        now: The clock by which a daemon is silent, s.
    """

    def __init__(
        self, cell: str, berths: Sequence[HostedLink], log: Log, now: Callable[[], float] = monotonic
    ) -> None:
        self._cell = cell
        self._berths = {berth.robot: berth for berth in berths}
        self._log = log
        self.now = now
        self._daemon: Connection | None = None
        self._connections: set[Connection] = set()
        self._ending = False
        self._over = asyncio.Event()

    async def run(self, listening: socket.socket, announce: Callable[[], None]) -> int:
        """Serve until told to end; then wait until the robots rest.

        Returns:
            Exit status: 0, or 1 if it was told twice.

        Raises:
            OSError: A link cannot be opened.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.end)
        try:
            for berth in self._berths.values():
                await berth.open()
            server = await loop.create_unix_server(lambda: Connection(self), sock=listening)
            announce()
            await self._over.wait()
            server.close()
        finally:
            for berth in self._berths.values():
                berth.close()
            for connection in tuple(self._connections):
                connection.abort()
        self._log.info("ended", resting=self.resting)
        return 0 if self.resting else 1

    @property
    def resting(self) -> bool:
        """Whether no robot has anything left to play."""
        return all(berth.resting for berth in self._berths.values())

    def end(self) -> None:
        """Take no plans any more, wait until the robots rest, then end; at once if this is called again."""
        if self._ending:
            self._over.set()
            return
        self._ending = True
        self._log.info("end")
        for berth in self._berths.values():
            berth.disarm()
        self._look_for_rest()

    def _look_for_rest(self) -> None:
        if self.resting:
            self._over.set()
        else:
            asyncio.get_running_loop().call_later(_LOOK, self._look_for_rest)

    def _tell_rest(self) -> None:
        """Without a daemon nobody else tells that the plans have run out."""
        if self.resting:
            self._log.info("at_rest")
        elif self._daemon is None:
            asyncio.get_running_loop().call_later(_LOOK, self._tell_rest)

    # --- connections --------------------------------------------------------------------------------------

    def opened(self, connection: "Connection") -> None:
        """Somebody connected."""
        self._connections.add(connection)

    def said(self, connection: "Connection", message: Message) -> None:
        """Somebody said something.

        Raises:
            CodecError: It is not his to say.
        """
        if isinstance(message, Hello) and not connection.greeted:
            self._greet(connection, message)
        elif connection is not self._daemon:
            raise CodecError(f"{type(message).__name__} before hello")
        else:
            self._obey(message)

    def gone(self, connection: "Connection", reason: str) -> None:
        """A connection is over."""
        self._connections.discard(connection)
        if connection is self._daemon:
            self._daemon = None
            for berth in self._berths.values():
                berth.leave()
            self._log.warning("daemon.gone", reason=reason, resting=self.resting)
            if not self._ending:
                self._tell_rest()

    def _greet(self, connection: "Connection", hello: Hello) -> None:
        connection.greeted = True
        objection = self._objection(hello)
        if objection:
            self._log.warning("daemon.refused", start=hello.start, reason=objection)
            connection.end(Refusal(objection))
            return
        self._daemon = connection
        connection.start = hello.start
        connection.say(Welcome(FORMAT))
        for standing in hello.robots:
            self._berths[standing.robot].take(hello.start, standing, connection.say)
        self._log.info("daemon", start=hello.start)

    def _objection(self, hello: Hello) -> str:
        if self._ending:
            return "the robot server is ending"
        if hello.cell != self._cell or [one.robot for one in hello.robots] != list(self._berths):
            return (
                "the robot server was started with another configuration (hash "
                f"{self._cell[:12]}, the daemon's is {hello.cell[:12]}): start both with the same files"
            )
        if self._daemon is not None:
            return f"the daemon of start {self._daemon.start} holds the robots: end it first"
        return ""

    def _obey(self, message: Message) -> None:
        match message:
            case Plan():
                self._berth(message.robot).offer(message)
            case Rebase():
                self._log.info("rebase", robot=message.robot, resets=message.resets)
                self._berth(message.robot).rebase(message)
            case Beat():
                pass
            case _:
                raise CodecError(f"{type(message).__name__} is not a daemon's to say")

    def _berth(self, robot: str) -> HostedLink:
        if robot not in self._berths:
            raise CodecError(f"no robot {robot}")
        return self._berths[robot]


class Connection(asyncio.Protocol):
    """A daemon's connection, or one that wants to be.

    Attributes:
        greeted: Whether it has said hello.
        start: The daemon's start id.
    """

    def __init__(self, server: RobotServer) -> None:
        self._server = server
        self._decoder = Decoder()
        self._transport: asyncio.Transport
        self._liveness = Liveness(server.now())
        self._timer: asyncio.TimerHandle | None = None
        self._over = False
        self.greeted = False
        self.start = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Somebody connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._server.opened(self)
        self._beat()

    def data_received(self, data: bytes) -> None:
        """Bytes came in."""
        self._liveness.heard(self._server.now())
        try:
            for message in self._decoder.push(data):
                if not self._over:
                    self._server.said(self, message)
        except CodecError as error:
            self.end(Refusal(str(error)))

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        self._close("connection lost" if exc is None else str(exc))

    def say(self, message: Up) -> None:
        """Tell; let go of a daemon that has left too much unread."""
        if self._over:
            return
        self._transport.write(encode(message))
        if self._transport.get_write_buffer_size() > BACKLOG:
            self._close(f"stalled: more than {BACKLOG} bytes are unread")
            self._transport.abort()

    def end(self, message: Refusal) -> None:
        """Say a last thing and close."""
        self.say(message)
        self._close(message.text)
        self._transport.close()

    def abort(self) -> None:
        """Close at once."""
        self._close("the robot server has ended")
        self._transport.abort()

    def _close(self, reason: str) -> None:
        if not self._over:
            self._over = True
            if self._timer is not None:
                self._timer.cancel()
            self._server.gone(self, reason)

    def _beat(self) -> None:
        if self._liveness.silent(self._server.now()):
            self._close("stalled: nothing was heard of it")
            self._transport.abort()
            return
        self._timer = asyncio.get_running_loop().call_later(BEAT, self._beat)
        if self.greeted:
            self.say(Beat())
