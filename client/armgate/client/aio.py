"""The asyncio shell of the SDK: the same names as the blocking one, awaited.

A lease lives as long as the program awaits the SDK often enough: while it waits, the SDK pings; a controller
that does something else for longer than the lease's time to live loses the lease. Several tasks may share a
connection.
"""

# ruff: noqa: ASYNC109 (timeouts are parameters here as there)

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Iterable
from time import monotonic
from types import TracebackType
from typing import Any, Self, TypeVar

from armgate.client.address import parse_address, socket_path
from armgate.client.asset import Download
from armgate.client.errors import ClientError, TimedOut
from armgate.client.handle import SOFTWARE, CellHandle, RobotHandle
from armgate.client.session import Session, build
from armgate.client.stream import AGAIN
from armgate.client.tick import Tick
from armgate.client.tls import Tls, check_token, context_of, no_connection, no_tls_on
from armgate.protocol.messages import (
    Acquire,
    Answer,
    Asset,
    Chunk,
    Describe,
    Description,
    Kick,
    Kicked,
    Lease,
    Ping,
    Pong,
    Release,
    Request,
    Reset,
    Resumed,
    Role,
    SessionInfo,
    SessionList,
    Sessions,
    State,
    Stop,
    Stopped,
    Subscribe,
    Subscribed,
    Verdict,
)

T = TypeVar("T")
A = TypeVar("A", bound=Answer)


async def connect(
    address: str,
    name: str,
    role: Role = "controller",
    token: str | None = None,
    *,
    tls: Tls = None,
    timeout: float = 5.0,
    patience: float = 30.0,
) -> "Cell":
    """Connects to a daemon, says hello and asks for the description of its cell.

    Args:
        address: ``HOST:PORT``, or ``unix:PATH`` of a socket on this machine.
        name: This client's name, as others see it; in lock-step a participant's.
        role: ``observer`` looks on, ``controller`` also moves robots, ``operator`` also resets and takes
            over.
        token: Where the daemon asks for one.
        tls: Where it speaks TLS: the file with its CA, True for the system's CAs, or an ``SSLContext``, see
            ``tls_context``.
        timeout: How long connecting and each answer may take, s.
        patience: How long the robots' clock may stand still before a wait for it ends, s.

    Raises:
        BadArgument: The address or the name has no sense, or the token would cross a network readable.
        ConnectionLost: Nobody listens there, or (``Rejected``) the daemon does not want this client.
        TimedOut: No welcome in time.
    """
    context = context_of(tls)
    wire = Wire(Session())
    try:
        await asyncio.wait_for(_call(wire, address, context), timeout)
    except OSError as error:
        raise no_connection(address, error) from error
    cell = Cell(wire, timeout, patience)
    try:
        check_token(token, context, wire.peer)
        await cell._greet(name, role, token)
    except BaseException:
        wire.close()
        raise
    return cell


async def _call(wire: "Wire", address: str, context: ssl.SSLContext | None) -> None:
    loop = asyncio.get_running_loop()
    path = socket_path(address)
    if path is None:
        await loop.create_connection(lambda: wire, *parse_address(address), ssl=context)
    else:
        no_tls_on(address, context)
        await loop.create_unix_connection(lambda: wire, sock=await _connected(path))


async def _connected(path: str) -> socket.socket:
    """Connect to a Unix socket; while its queue is full, which asyncio takes for success, try again."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    sock.setblocking(False)
    try:
        while True:
            try:
                sock.connect(path)
            except BlockingIOError:
                await asyncio.sleep(AGAIN)
            else:
                return sock
    except BaseException:
        sock.close()
        raise


class Wire(asyncio.Protocol):
    """The stream: hands what comes to the session and wakes who waits."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.changed = asyncio.Event()
        self.writable = asyncio.Event()
        self.writable.set()
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The stream stands."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    @property
    def peer(self) -> Any:
        """The address of the other end."""
        return self._transport.get_extra_info("peername")

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        self.session.receive(data)
        self.changed.set()

    def eof_received(self) -> None:
        """The server sends no more."""
        self.session.receive_eof()
        self.changed.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """The stream is gone."""
        self.session.receive_eof(f"the connection broke ({exc or 'closed'})")
        self.changed.set()
        self.writable.set()

    def pause_writing(self) -> None:
        """The server reads slowly."""
        self.writable.clear()

    def resume_writing(self) -> None:
        """The server has caught up."""
        self.writable.set()

    def write(self, data: bytes) -> None:
        """Hands bytes to the stream."""
        self._transport.write(data)
        self.session.sent(monotonic())

    def close(self) -> None:
        """Closes the stream once all is written."""
        self._transport.close()


class Cell(CellHandle):
    """A connection to a cell; a context manager that closes it."""

    def __init__(self, wire: Wire, timeout: float, patience: float) -> None:
        super().__init__(wire.session, timeout, patience)
        self._wire = wire

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # --- the cell ------------------------------------------------------------------------------------------

    async def acquire(self, robot: str, *, speed: float = 1.0, takeover: bool = False) -> "Robot":
        """Takes the lease of a robot; use it as a context manager, which gives it back.

        Args:
            robot: Its name.
            speed: An own, tighter speed bound, a fraction of the cell's.
            takeover: Take it from its holder (operators).

        Raises:
            Refused: ``leased``, ``stopped``, ``unknown_robot`` or ``forbidden``.
        """
        lease = await self._ask(build(Acquire, robot=robot, speed=speed, takeover=takeover), Lease)
        return Robot(self, lease)

    async def subscribe(
        self, every: int = 1, robots: Iterable[str] | None = None, fields: Iterable[str] | None = None
    ) -> Subscribed:
        """Asks for the state at every n-th tick of these robots (None: all) with these fields (None: all)."""
        own = None if robots is None else tuple(robots)
        shown = None if fields is None else tuple(fields)
        return await self._ask(build(Subscribe, every=every, robots=own, fields=shown), Subscribed)

    async def states(self, timeout: float | None = None, backlog: int = 1) -> AsyncIterator[State]:
        """Yields states; who is slow misses some.

        Subscribes to all at every tick unless something is subscribed.

        Args:
            timeout: How long to wait for the next one, s; None: ``patience``, in lock-step no bound.
            backlog: How many states may wait here to be yielded in their order; 1: always the newest.
        """
        if self._session.subscription is None:
            await self.subscribe()
        self._session.keep_states(backlog)
        seen = 0
        while True:
            limit = self._clock_limit(timeout)
            seen, state = await self._wait(self._poll_state(seen), limit, "a state")
            yield state

    @property
    def state(self) -> State | None:
        """The newest state; None before the first, see ``subscribe``."""
        return self._session.state

    async def skip(self) -> None:
        """Lock-step: nothing from this client for the newest step; for participants that hold no robot."""
        await self._write(self._session.skip())

    async def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Shares a number, or a short vector of them, with all clients; does not wait.

        Args:
            name: Of the signal.
            value: The number or numbers.
            more: Whether something will be said right after it, a command, say: then both go as one.

        Raises:
            Refused: An earlier signal was refused; those that came too fast are only counted.
        """
        await self._write(self._session.signal(name, value, more=more))

    async def stop(self, robot: str | None = None, reason: str = "") -> Stopped:
        """Stops one robot, or all; anybody may. The answer holds the stop's id."""
        return await self._ask(build(Stop, robot=robot, reason=reason), Stopped)

    async def reset(self, stop: int) -> Resumed:
        """Lifts a stop (operators); leases must be taken again.

        Raises:
            Refused: ``unknown_stop`` (also if a newer stop took its place), ``moving`` or ``forbidden``.
        """
        return await self._ask(build(Reset, stop=stop), Resumed)

    async def sessions(self) -> tuple[SessionInfo, ...]:
        """Return the sessions of the daemon (operators).

        Raises:
            Refused: ``forbidden``, or the daemon does not know this (``unknown_type``).
        """
        return (await self._ask(build(Sessions), SessionList)).sessions

    async def kick(self, session: str, reason: str = "") -> None:
        """End a session; its robots play their plans to rest (operators).

        Raises:
            Refused: ``unknown_session`` or ``forbidden``.
        """
        await self._ask(build(Kick, session=session, reason=reason), Kicked)

    async def ping(self) -> float:
        """How long an answer takes, s."""
        start = monotonic()
        await self._ask(Ping(time=start), Pong)
        return monotonic() - start

    async def asset(self, name: str) -> bytes:
        """The asset of this SHA-256, as the description names it; fetched once, checked against its hash."""
        if name not in self._assets:
            download = Download(name)
            data = None
            while data is None:
                data = download.take(await self._ask(build(Asset, **download.request()), Chunk))
            self._assets[name] = data
        return self._assets[name]

    async def urdf(self, robot: str) -> str:
        """The robot's URDF."""
        return (await self.asset(self.robot(robot).urdf.hash)).decode()

    async def close(self) -> None:
        """Says bye and closes; leases end with it and robots come to rest."""
        try:
            self._wire.write(self._session.bye())
        finally:
            self._wire.close()

    # --- waiting -------------------------------------------------------------------------------------------

    async def _greet(self, name: str, role: Role, token: str | None) -> None:
        await self._write(self._session.hello(name, role, token, SOFTWARE))
        await self._wait(lambda: self._session.welcome, self.timeout, "a welcome")
        self.description = await self._ask(Describe(), Description)

    async def _ask(self, request: Request, kind: type[A]) -> A:
        number, data = self._session.ask(request)
        # In lock-step the answer may have to wait for the others' step.
        limit = None if self.welcome.lockstep else self.timeout
        poll = self._session.pending.answer
        try:
            await self._write(data)
            return await self._wait(lambda: poll(number, kind), limit, f"an answer to {request.type}")
        finally:
            self._session.pending.forget_answer(number)

    async def _wait(self, poll: Callable[[], T | None], timeout: float | None, what: str) -> T:
        deadline = float("inf") if timeout is None else monotonic() + timeout
        if kept := self._session.kept():
            await self._write(kept)
        await self._drain()
        while (found := poll()) is None:
            self._session.check()
            await self._turn(deadline, f"{what} did not come within {timeout} s")
        return found

    async def _turn(self, deadline: float, late: str) -> None:
        now = monotonic()
        if now >= deadline:
            raise TimedOut(f"{late}; is the server overloaded, or the network slow?")
        if ping := self._session.keepalive(now):
            self._wire.write(ping)
        self._session.check_silence(now, self.timeout)
        self._wire.changed.clear()
        await _bounded(self._wire.changed, min(deadline, self._session.keepalive_due) - now)

    async def _drain(self) -> None:
        # The loop looks at the socket after what is ready already: two rounds let it read what has come.
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    async def _write(self, data: bytes) -> None:
        if not data:
            return
        self._wire.write(data)
        # A loop that only sends must let the event loop read, too: else it never learns that nobody listens.
        await asyncio.sleep(0)
        if not await _bounded(self._wire.writable, self.timeout):
            self._session.receive_eof(f"the server has read nothing for {self.timeout:g} s")
            self._session.check()


async def _bounded(event: asyncio.Event, timeout: float) -> bool:
    """Waits for an event; whether it came in time."""
    try:
        async with asyncio.timeout(None if timeout == float("inf") else timeout):
            await event.wait()
    except TimeoutError:
        return False
    return True


class Robot(RobotHandle):
    """A robot that this client holds; a context manager that gives it back."""

    def __init__(self, cell: Cell, lease: Lease) -> None:
        super().__init__(cell._session, lease)
        self._cell = cell

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            await self.release()
        except ClientError:
            if error is None:
                raise

    async def ticks(self, timeout: float | None = None) -> AsyncIterator[Tick]:
        """Yields one tick per cycle of this robot's clock, always the newest: who is slow misses some.

        ``timeout`` bounds the wait for the next one, s; None: the cell's ``patience``, in lock-step no bound.

        Raises:
            LeaseLost: The robot is no longer this client's.
            RobotStopped: It was stopped.
            ConnectionLost: There is no connection any more.
            Refused: The server could not read an earlier message that nobody waited for.
        """
        if (missing := self._session.wanted(self.name)) is not None:
            await self._cell._ask(missing, Subscribed)
        while True:
            limit = self._cell._clock_limit(timeout)
            self.tick = await self._cell._wait(self._poll(), limit, f"a tick of {self.name}")
            yield self.tick

    async def send(self, dq: Any, timeout: float | None = None) -> Verdict:
        """Asks for the increment ``dq`` (rad or m by joint) to the setpoint and waits for the verdict.

        Raises:
            Refused: The command could not be read, so that it has no verdict.
            Lost, ConnectionLost, TimedOut: As for ``ticks``.
        """
        seq, data = self._command(dq)
        self._session.pending.expect_verdict(seq)
        try:
            await self._cell._write(data)
            limit = self._cell._verdict_limit(timeout)
            return await self._cell._wait(lambda: self._session.pending.verdict(seq), limit, "a verdict")
        finally:
            self._session.pending.forget_verdict(seq)

    async def post(self, dq: Any) -> int:
        """As ``send`` without waiting; gives the number that the verdict in ``verdicts`` will have."""
        seq, data = self._command(dq)
        await self._cell._write(data)
        return seq

    async def skip(self) -> None:
        """Lock-step: nothing from this client for this step. By the wall clock there is nothing to say."""
        await self._cell._write(self._pass())

    async def release(self) -> None:
        """Gives the lease back, if it is still held; the robot comes to rest."""
        if self.held:
            await self._cell._ask(Release(robot=self.name, fence=self.lease.fence), Lease)
