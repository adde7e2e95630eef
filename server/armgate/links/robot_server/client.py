"""The daemon's side of the robot server's socket.

Ticks, changes of links and answers to plans arrive as events. If the connection is lost, all robots count as
lost, and the client reconnects until it succeeds.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import assert_never

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.robot_server.codec import CodecError, encode
from armgate.links.robot_server.connection import Connection
from armgate.links.robot_server.messages import (
    FORMAT,
    Heartbeat,
    Hello,
    Message,
    Refusal,
    ResumePoint,
    TickReport,
    ToServer,
    Welcome,
)
from armgate.links.robot_server.unix_socket import SocketError, connect

RETRY = 0.5
"""Time between two attempts to reconnect, s."""

RemoteEvent = Tick | LinkChange | PlanAnswer
"""Event that arrives from the robot server."""


class RemoteLink:
    """Link of one robot in the robot server; its answers to plans arrive later, as events.

    Args:
        robot: Name of the robot.
        send: Sends a message to the robot server.
    """

    def __init__(self, robot: str, send: Callable[[ToServer], None]) -> None:
        self.robot = robot
        self._send = send
        self._resets = 0
        self._next = 0
        self._remaining = 0
        self._offered: dict[PlanKey, int] = {}

    @property
    def remaining(self) -> int:
        """Largest number of increments that may be left to play; 0 at rest.

        It counts plans that were sent and are not answered yet.
        """
        return max(self._remaining, *self._offered.values(), 0)

    @property
    def resume_point(self) -> ResumePoint:
        """Point from which the daemon continues with this robot."""
        return ResumePoint(self.robot, self._next, self._resets)

    def offer(self, plan: Plan) -> None:
        """Send a plan."""
        self._offered[plan.key] = len(plan.increments)
        self._send(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Send a rebase; earlier ticks are ignored from now on."""
        self._resets = rebase.resets
        self._send(rebase)

    def take_tick(self, report: TickReport) -> Tick | None:
        """Return the reported tick; None if it is older than a rebase that was sent."""
        if report.resets != self._resets:
            return None
        tick = report.event
        self._next, self._remaining = tick.tick + 1, report.remaining
        self._offered = {key: length for key, length in self._offered.items() if key.target > tick.tick}
        return tick

    def take_answer(self, answer: PlanAnswer) -> None:
        """Note the answer to a plan."""
        length = self._offered.pop(answer.key, 0)
        if answer.accepted:
            self._remaining = max(self._remaining, length)

    def lose(self) -> None:
        """Forget the plans that were sent: the robot server is gone."""
        self._offered.clear()
        self._remaining = 0


class RobotServerClient:
    """Client of the robot server, which reconnects by itself.

    Args:
        path: Path of its socket.
        cell: Hash of the cell.
        robots: Names of the robots, in the order of the configuration.
        start: Start id of the daemon.
        now: The machine's monotonic clock, which also stamps ticks, s.

    Attributes:
        links: The robots' links, in the same order.
    """

    def __init__(
        self,
        path: Path,
        cell: str,
        robots: Sequence[str],
        start: str,
        now: Callable[[], float] = monotonic,
    ) -> None:
        self.links = [RemoteLink(robot, self._send) for robot in robots]
        self._by_name = {link.robot: link for link in self.links}
        self._path = path
        self._cell = cell
        self._start = start
        self._now = now
        self._origin = now()
        self._emit: Callable[[RemoteEvent], None] | None = None
        self._early: list[RemoteEvent] = []
        self._connection: ClientConnection | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self._now() - self._origin

    async def open(self) -> None:
        """Connect; events are buffered until `start`.

        Raises:
            SocketError: There is no robot server, or it refuses the daemon; the text names reason and remedy.
        """
        await self._connect()

    def start(self, emit: Callable[[RemoteEvent], None]) -> None:
        """Call ``emit`` with each buffered event, and from now on with each event that arrives."""
        self._emit = emit
        early, self._early = self._early, []
        for event in early:
            emit(event)

    def close(self) -> None:
        """Disconnect; the robots play their plans to the end."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        if self._task is not None:
            self._task.cancel()
        if self._connection is not None:
            self._connection.abort()

    # --- the connection -----------------------------------------------------------------------------------

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        hello = Hello(FORMAT, self._cell, self._start, tuple(link.resume_point for link in self.links))
        connection = ClientConnection(self._now, self)
        await loop.create_unix_connection(lambda: connection, sock=connect(self._path))
        connection.send(hello)
        refusal = await connection.refusal
        if refusal:
            raise SocketError(f"the robot server at {self._path} refused the daemon: {refusal}")

    def _send(self, message: ToServer) -> None:
        if self._connection is not None:  # otherwise the connection is lost, which was already reported
            self._connection.send(message)

    def welcomed(self, connection: "ClientConnection") -> None:
        """Use this connection from now on."""
        self._connection = connection

    def lost(self, reason: str) -> None:
        """Report all robots as lost with the connection, and reconnect."""
        lost, self._connection = self._connection, None
        if self._closed or lost is None:
            return
        for link in self.links:
            link.lose()
            self._report(LinkChange(link.robot, LinkState.LOST, f"the robot server: {reason}"))
        self._retry_later()

    def _retry_later(self) -> None:
        if not self._closed:
            self._timer = asyncio.get_running_loop().call_later(RETRY, self._retry)

    def _retry(self) -> None:
        self._task = asyncio.get_running_loop().create_task(self._reconnect())

    async def _reconnect(self) -> None:
        try:
            await self._connect()
        except SocketError:
            self._retry_later()

    # --- messages -----------------------------------------------------------------------------------------

    def receive(self, message: TickReport | PlanAnswer | LinkChange) -> None:
        """Handle a message about a robot.

        Raises:
            CodecError: The cell has no such robot.
        """
        match message:
            case TickReport():
                tick = self._link(message.event.robot).take_tick(message)
                if tick is not None:
                    self._report(replace(tick, time=tick.time - self._origin))
            case PlanAnswer():
                self._link(message.robot).take_answer(message)
                self._report(message)
            case LinkChange():
                self._link(message.robot)
                self._report(message)
            case _:
                assert_never(message)

    def _report(self, event: RemoteEvent) -> None:
        if self._emit is None:
            self._early.append(event)
        else:
            self._emit(event)

    def _link(self, robot: str) -> RemoteLink:
        if robot not in self._by_name:
            raise CodecError(f"no robot {robot}")
        return self._by_name[robot]


class ClientConnection(Connection):
    """The daemon's end of one connection.

    Attributes:
        refusal: Result of the handshake: reason of the refusal, "" if the daemon was accepted.
    """

    def __init__(self, now: Callable[[], float], client: RobotServerClient) -> None:
        super().__init__(now)
        self._client = client
        self._reason = ""
        self.refusal: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    @property
    def established(self) -> bool:
        """True once the robot server has answered the hello."""
        return self.refusal.done()

    def send(self, message: ToServer) -> None:
        """Send a message unless the connection is closing."""
        if not self._transport.is_closing():
            self._transport.write(encode(message))

    def connection_lost(self, exc: Exception | None) -> None:
        """Report the loss, or fail the handshake."""
        self._stop_timer()
        reason = self._reason or ("connection lost" if exc is None else str(exc))
        if self.established:
            self._client.lost(reason)
        else:
            self.refusal.set_result(reason)

    def _receive(self, message: Message) -> None:
        match message:
            case Heartbeat():
                pass
            case Refusal():
                self._reason = message.text
            case Welcome() if not self.established:
                self._client.welcomed(self)
                self.refusal.set_result("")
            case TickReport() | LinkChange() | PlanAnswer() if self.established:
                self._client.receive(message)
            case TickReport() | LinkChange() | PlanAnswer():
                raise CodecError(f"{type(message).__name__} before the welcome")
            case Welcome() | Hello() | Plan() | Rebase():
                raise CodecError(f"the robot server must not send {type(message).__name__} now")
            case _:
                assert_never(message)

    def _reject(self, reason: str) -> None:
        self._reason = reason
        self._transport.abort()

    _stalled = _reject
