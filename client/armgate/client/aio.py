"""asyncio shell of the SDK, with the same names as the blocking shell.

Arguments, results and exceptions of each method are those of the method with the same name in
``armgate.client.blocking``, which documents them.

The SDK sends pings while the program awaits one of its calls. A program that awaits no call for longer than
the lease's time to live loses its leases. Several tasks may share a connection.
"""

# ruff: noqa: ASYNC109 (timeouts are parameters, as in the blocking shell)

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from time import monotonic
from types import TracebackType
from typing import Any, Self, TypeVar

from armgate.client.aio_stream import Stream
from armgate.client.asset import Download
from armgate.client.base import SOFTWARE, CellBase, RobotBase
from armgate.client.errors import ClientError
from armgate.client.security import Tls, check_token, context_of, no_connection
from armgate.client.session import Session, build
from armgate.client.tick import Tick
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
    """Connect to a daemon, send hello and request the description of its cell.

    Arguments and exceptions are those of ``armgate.client.connect``.
    """
    context = context_of(tls)
    stream = Stream(Session())
    try:
        await asyncio.wait_for(stream.open(address, context), timeout)
    except OSError as error:
        raise no_connection(address, error) from error
    cell = Cell(stream, timeout, patience)
    try:
        check_token(token, context, stream.peer)
        await cell._greet(name, role, token)
    except BaseException:
        stream.close()
        raise
    return cell


class Cell(CellBase):
    """Connection to a cell; an asynchronous context manager that closes it."""

    def __init__(self, stream: Stream, timeout: float, patience: float) -> None:
        super().__init__(stream.session, timeout, patience)
        self._stream = stream

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # --- the cell ------------------------------------------------------------------------------------------

    async def acquire(self, robot: str, *, speed: float = 1.0, takeover: bool = False) -> "Robot":
        """Acquire the lease of a robot; the result is a context manager that releases it."""
        lease = await self._ask(build(Acquire, robot=robot, speed=speed, takeover=takeover), Lease)
        return Robot(self, lease)

    async def subscribe(
        self, every: int = 1, robots: Iterable[str] | None = None, fields: Iterable[str] | None = None
    ) -> Subscribed:
        """Subscribe to states at every n-th tick of some robots."""
        return await self._ask(self._subscription(every, robots, fields), Subscribed)

    async def states(self, timeout: float | None = None, backlog: int = 1) -> AsyncIterator[State]:
        """Yield states; a slow program misses some."""
        if self._session.subscription is None:
            await self.subscribe()
        self._session.keep_states(backlog)
        seen = 0
        while True:
            limit = self._clock_limit(timeout)
            seen, state = await self._wait(self._poll_state(seen), limit, "a state")
            yield state

    async def skip(self) -> None:
        """End the newest step without a command, in lock-step; for participants that hold no robot."""
        await self._write(self._session.skip())

    async def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Share a number or a short vector with all clients, without waiting for the answer."""
        await self._write(self._session.signal(name, value, more=more))

    async def stop(self, robot: str | None = None, reason: str = "") -> Stopped:
        """Stop one robot, or all; every role may stop."""
        return await self._ask(build(Stop, robot=robot, reason=reason), Stopped)

    async def reset(self, stop: int) -> Resumed:
        """Lift a stop (operators only); its robots must be acquired again."""
        return await self._ask(build(Reset, stop=stop), Resumed)

    async def sessions(self) -> tuple[SessionInfo, ...]:
        """Return the sessions of the daemon (operators only)."""
        return (await self._ask(build(Sessions), SessionList)).sessions

    async def kick(self, session: str, reason: str = "") -> None:
        """End a session (operators only); its robots play their plans to rest."""
        await self._ask(build(Kick, session=session, reason=reason), Kicked)

    async def ping(self) -> float:
        """Measure and return the round-trip time to the daemon, s."""
        start = monotonic()
        await self._ask(Ping(time=start), Pong)
        return monotonic() - start

    async def asset(self, name: str) -> bytes:
        """Return an asset of the description; download and verify it once."""
        if name not in self._assets:
            download = Download(name)
            data = None
            while data is None:
                data = download.take(await self._ask(build(Asset, **download.request()), Chunk))
            self._assets[name] = data
        return self._assets[name]

    async def urdf(self, robot: str) -> str:
        """Return the URDF of a robot."""
        return (await self.asset(self.robot(robot).urdf.hash)).decode()

    async def close(self) -> None:
        """Send bye and close the connection; its leases end, and their robots come to rest."""
        try:
            self._stream.write(self._session.bye())
        finally:
            self._stream.close()

    # --- waiting -------------------------------------------------------------------------------------------

    async def _greet(self, name: str, role: Role, token: str | None) -> None:
        await self._write(self._session.hello(name, role, token, SOFTWARE))
        await self._wait(lambda: self._session.welcome, self.timeout, "a welcome")
        self.description = await self._ask(Describe(), Description)

    async def _ask(self, request: Request, kind: type[A]) -> A:
        number, data = self._session.ask(request)
        poll = self._session.pending.answer
        try:
            await self._write(data)
            limit = self._answer_limit()
            return await self._wait(lambda: poll(number, kind), limit, f"an answer to {request.type}")
        finally:
            self._session.pending.forget_answer(number)

    async def _wait(self, poll: Callable[[], T | None], timeout: float | None, what: str) -> T:
        deadline = float("inf") if timeout is None else monotonic() + timeout
        await self._write(self._session.delayed())
        await self._let_loop_read()
        while (found := poll()) is None:
            if ping := self._keepalive(deadline, what, timeout):
                self._stream.write(ping)
            await self._stream.wait(self._pause(deadline))
        return found

    async def _let_loop_read(self) -> None:
        # The event loop polls the socket after the tasks that are ready: two rounds let it read all input.
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    async def _write(self, data: bytes) -> None:
        if not data:
            return
        self._stream.write(data)
        # A program that only sends must let the event loop read, to notice a lost connection.
        await asyncio.sleep(0)
        if not await self._stream.drain(self.timeout):
            self._session.receive_eof(f"the server has read nothing for {self.timeout:g} s")
            self._session.check()


class Robot(RobotBase):
    """Robot whose lease this client holds; an asynchronous context manager that releases it."""

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
        """Yield the newest tick of this robot's clock, one per cycle; a slow program misses some."""
        if (missing := self._session.missing_subscription(self.name)) is not None:
            await self._cell._ask(missing, Subscribed)
        while True:
            limit = self._cell._clock_limit(timeout)
            self.tick = await self._cell._wait(self._poll(), limit, f"a tick of {self.name}")
            yield self.tick

    async def send(self, dq: Any, timeout: float | None = None) -> Verdict:
        """Request the increment ``dq`` (rad or m by joint) to the setpoint, and return the verdict."""
        seq, data = self._command(dq)
        self._session.pending.expect_verdict(seq)
        try:
            await self._cell._write(data)
            limit = self._cell._verdict_limit(timeout)
            return await self._cell._wait(lambda: self._session.pending.verdict(seq), limit, "a verdict")
        finally:
            self._session.pending.forget_verdict(seq)

    async def post(self, dq: Any) -> int:
        """Send a command like ``send``, without waiting; return the ``seq`` of its verdict."""
        seq, data = self._command(dq)
        await self._cell._write(data)
        return seq

    async def skip(self) -> None:
        """End this step without a command, in lock-step; do nothing by the wall clock."""
        await self._cell._write(self._pass())

    async def release(self) -> None:
        """Release the lease, if it is still held; the robot comes to rest."""
        if self.held:
            await self._cell._ask(Release(robot=self.name, fence=self.lease.fence), Lease)
