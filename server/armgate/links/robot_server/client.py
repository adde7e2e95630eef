"""The daemon's side of the robot server's socket: robots that are somewhere else.

Ticks, changes of links and answers to plans come in by themselves. When the connection is lost, all robots
are: the daemon is told so, and the way back is tried until it is there.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.robot_server.codec import CodecError, Decoder, encode
from armgate.links.robot_server.heartbeat import BEAT, Liveness
from armgate.links.robot_server.messages import (
    FORMAT,
    Beat,
    Down,
    Hello,
    Message,
    Played,
    Refusal,
    Standing,
    Welcome,
)
from armgate.links.robot_server.unix_socket import SocketError, call

RETRY = 0.5
"""Time between two attempts to get back, s."""

RemoteEvent = Tick | LinkChange | PlanAnswer
"""What comes from the robot server."""


class RemoteLink:
    """One robot behind the robot server; its answers to plans come later, as events.

    Args:
        robot: Its name.
        say: Tells the robot server.
    """

    def __init__(self, robot: str, say: Callable[[Down], None]) -> None:
        self.robot = robot
        self._say = say
        self._resets = 0
        self._next = 0
        self._remaining = 0
        self._asked: dict[PlanKey, int] = {}

    @property
    def remaining(self) -> int:
        """How many increments may still be to be played, as far as is known here; 0 at rest."""
        return max(self._remaining, *self._asked.values(), 0)

    @property
    def standing(self) -> Standing:
        """What to tell a robot server about this robot."""
        return Standing(self.robot, self._next, self._resets)

    def offer(self, plan: Plan) -> None:
        """Send a plan."""
        self._asked[plan.key] = len(plan.increments)
        self._say(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Send a rebase; ticks from before it do not count any more."""
        self._resets = rebase.resets
        self._say(rebase)

    def played(self, played: Played) -> Tick | None:
        """A tick came; None if it is from before a rebase that has been sent."""
        if played.resets != self._resets:
            return None
        tick = played.event
        self._next, self._remaining = tick.tick + 1, played.remaining
        self._asked = {key: length for key, length in self._asked.items() if key.target > tick.tick}
        return tick

    def answered(self, answer: PlanAnswer) -> None:
        """An answer came."""
        length = self._asked.pop(answer.key, 0)
        if answer.accepted:
            self._remaining = max(self._remaining, length)

    def lost(self) -> None:
        """The robot server is gone, and with it what was sent."""
        self._asked.clear()
        self._remaining = 0


class RobotServerClient:
    """The connection to the robot server.

    Args:
        path: Its socket.
        cell: The cell's hash.
        robots: Their names, in the order of the configuration.
        start: The daemon's start id.
        now: The machine's monotonic clock, by which ticks are stamped, s.

    Attributes:
        links: The robots, in that order.
    """

    def __init__(
        self,
        path: Path,
        cell: str,
        robots: Sequence[str],
        start: str,
        now: Callable[[], float] = monotonic,
    ) -> None:
        self.links = [RemoteLink(robot, self._say) for robot in robots]
        self._by_name = {link.robot: link for link in self.links}
        self._path = path
        self._cell = cell
        self._start = start
        self._now = now
        self._origin = now()
        self._emit: Callable[[RemoteEvent], None] | None = None
        self._early: list[RemoteEvent] = []
        self._wire: _Wire | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self._now() - self._origin

    async def open(self) -> None:
        """Get the robots; what comes is kept until the start.

        Raises:
            SocketError: There is no robot server, or it refuses; the text says why, and what to do.
        """
        await self._connect()

    def start(self, emit: Callable[[RemoteEvent], None]) -> None:
        """Tell ``emit`` of all that has come and comes."""
        self._emit = emit
        early, self._early = self._early, []
        for event in early:
            emit(event)

    def close(self) -> None:
        """Let go of the robots: they play their plans to the end."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        if self._task is not None:
            self._task.cancel()
        if self._wire is not None:
            self._wire.abort()

    # --- the connection -----------------------------------------------------------------------------------

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        hello = Hello(FORMAT, self._cell, self._start, tuple(link.standing for link in self.links))
        wire = _Wire(self._now, self)
        await loop.create_unix_connection(lambda: wire, sock=call(self._path))
        wire.say(hello)
        refusal = await wire.refusal
        if refusal:
            raise SocketError(f"the robot server at {self._path} refuses: {refusal}")

    def _say(self, message: Down) -> None:
        if self._wire is not None:  # else it is lost, and the gate has been told
            self._wire.say(message)

    def welcomed(self, wire: "_Wire") -> None:
        """The robots are ours: what comes from now on counts."""
        self._wire = wire

    def lose(self, reason: str) -> None:
        """The connection is gone, and all robots with it."""
        lost, self._wire = self._wire, None
        if self._closed or lost is None:
            return
        for link in self.links:
            link.lost()
            self._tell(LinkChange(link.robot, LinkState.LOST, f"the robot server: {reason}"))
        self._retry_later()

    def _retry_later(self) -> None:
        if not self._closed:
            self._timer = asyncio.get_running_loop().call_later(RETRY, self._retry)

    def _retry(self) -> None:
        self._task = asyncio.get_running_loop().create_task(self._again())

    async def _again(self) -> None:
        try:
            await self._connect()
        except SocketError:
            self._retry_later()

    # --- what comes ---------------------------------------------------------------------------------------

    def hear(self, message: Message) -> None:
        """The robot server said something.

        Raises:
            CodecError: It is not its to say.
        """
        match message:
            case Played():
                tick = self._link(message.event.robot).played(message)
                if tick is not None:
                    self._tell(replace(tick, time=tick.time - self._origin))
            case PlanAnswer():
                self._link(message.robot).answered(message)
                self._tell(message)
            case LinkChange():
                self._link(message.robot)
                self._tell(message)
            case _:
                raise CodecError(f"{type(message).__name__} is not the robot server's to say")

    def _tell(self, event: RemoteEvent) -> None:
        if self._emit is None:
            self._early.append(event)
        else:
            self._emit(event)

    def _link(self, robot: str) -> RemoteLink:
        if robot not in self._by_name:
            raise CodecError(f"no robot {robot}")
        return self._by_name[robot]


class _Wire(asyncio.Protocol):
    """One connection.

    Attributes:
        refusal: Why the robots are not to be had, "" once they are.
    """

    def __init__(self, now: Callable[[], float], client: RobotServerClient) -> None:
        self._now, self._client = now, client
        self._decoder = Decoder()
        self._liveness = Liveness(now())
        self._transport: asyncio.Transport
        self._timer: asyncio.TimerHandle | None = None
        self._why = ""
        self.refusal: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._beat()

    def data_received(self, data: bytes) -> None:
        """Bytes came in."""
        self._liveness.heard(self._now())
        try:
            for message in self._decoder.push(data):
                self._take(message)
        except CodecError as error:
            self._why = str(error)
            self._transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        if self._timer is not None:
            self._timer.cancel()
        why = self._why or ("connection lost" if exc is None else str(exc))
        if self.refusal.done():
            self._client.lose(why)
        else:
            self.refusal.set_result(why)

    def say(self, message: Down) -> None:
        """Tell the robot server."""
        if not self._transport.is_closing():
            self._transport.write(encode(message))

    def abort(self) -> None:
        """Close at once."""
        self._transport.abort()

    def _take(self, message: Message) -> None:
        match message:
            case Welcome() if not self.refusal.done():
                self._client.welcomed(self)
                self.refusal.set_result("")
            case Refusal():
                self._why = message.text
            case Beat():
                pass
            case _ if self.refusal.done():
                self._client.hear(message)
            case _:
                raise CodecError(f"{type(message).__name__} before the welcome")

    def _beat(self) -> None:
        if self._liveness.silent(self._now()):
            self._why = "stalled: nothing was heard of it"
            self._transport.abort()
            return
        self._timer = asyncio.get_running_loop().call_later(BEAT, self._beat)
        if self.refusal.done():
            self.say(Beat())
