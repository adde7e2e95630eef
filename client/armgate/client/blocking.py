"""The blocking shell of the SDK: a plain socket, no thread. ``armgate.client.connect`` is this one's.

Nothing is read between two calls, so a lease lives as long as the program calls the SDK often enough: while
it waits, the SDK pings; a controller that computes for longer than the lease's time to live loses the lease.
Handles belong to one thread at a time.
"""

import ssl
from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from types import TracebackType
from typing import Any, Self, TypeVar

from armgate.client.address import parse_address, socket_path
from armgate.client.asset import Download
from armgate.client.errors import ClientError, TimedOut
from armgate.client.handle import SOFTWARE, CellHandle, RobotHandle
from armgate.client.session import Session, build
from armgate.client.stream import Stream
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

_ROUNDS = 64
"""How often the socket is read before what came is looked at: a flood must not hold up a tick."""

T = TypeVar("T")
A = TypeVar("A", bound=Answer)


def connect(
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
    try:
        stream = _call(address, timeout, context)
    except OSError as error:
        raise no_connection(address, error) from error
    cell = Cell(stream, Session(), timeout, patience)
    try:
        check_token(token, context, stream.peer)
        cell._greet(name, role, token)
    except BaseException:
        stream.close()
        raise
    return cell


def _call(address: str, timeout: float, context: ssl.SSLContext | None) -> Stream:
    path = socket_path(address)
    if path is None:
        return Stream.open(*parse_address(address), timeout, context)
    no_tls_on(address, context)
    return Stream.open_local(path, timeout)


class Cell(CellHandle):
    """A connection to a cell; a context manager that closes it."""

    def __init__(self, stream: Stream, session: Session, timeout: float, patience: float) -> None:
        super().__init__(session, timeout, patience)
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- the cell ------------------------------------------------------------------------------------------

    def acquire(self, robot: str, *, speed: float = 1.0, takeover: bool = False) -> "Robot":
        """Takes the lease of a robot; use it as a context manager, which gives it back.

        Args:
            robot: Its name.
            speed: An own, tighter speed bound, a fraction of the cell's.
            takeover: Take it from its holder (operators).

        Raises:
            Refused: ``leased``, ``stopped``, ``unknown_robot`` or ``forbidden``.
        """
        lease = self._ask(build(Acquire, robot=robot, speed=speed, takeover=takeover), Lease)
        return Robot(self, lease)

    def subscribe(
        self, every: int = 1, robots: Iterable[str] | None = None, fields: Iterable[str] | None = None
    ) -> Subscribed:
        """Asks for the state at every n-th tick of these robots (None: all) with these fields (None: all)."""
        own = None if robots is None else tuple(robots)
        shown = None if fields is None else tuple(fields)
        return self._ask(build(Subscribe, every=every, robots=own, fields=shown), Subscribed)

    def states(self, timeout: float | None = None, backlog: int = 1) -> Iterator[State]:
        """Yields states; who is slow misses some.

        Subscribes to all at every tick unless something is subscribed.

        Args:
            timeout: How long to wait for the next one, s; None: ``patience``, in lock-step no bound.
            backlog: How many states may wait here to be yielded in their order; 1: always the newest.
        """
        if self._session.subscription is None:
            self.subscribe()
        self._session.keep_states(backlog)
        seen = 0
        while True:
            limit = self._clock_limit(timeout)
            seen, state = self._wait(self._poll_state(seen), limit, "a state")
            yield state

    @property
    def state(self) -> State | None:
        """The newest state; None before the first, see ``subscribe``."""
        self._drain()
        return self._session.state

    def skip(self) -> None:
        """Lock-step: nothing from this client for the newest step; for participants that hold no robot."""
        self._write(self._session.skip())

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Shares a number, or a short vector of them, with all clients; does not wait.

        Args:
            name: Of the signal.
            value: The number or numbers.
            more: Whether something will be said right after it, a command, say: then both go as one.

        Raises:
            Refused: An earlier signal was refused; those that came too fast are only counted.
        """
        self._drain()
        self._write(self._session.signal(name, value, more=more))

    def stop(self, robot: str | None = None, reason: str = "") -> Stopped:
        """Stops one robot, or all; anybody may. The answer holds the stop's id."""
        return self._ask(build(Stop, robot=robot, reason=reason), Stopped)

    def reset(self, stop: int) -> Resumed:
        """Lifts a stop (operators); leases must be taken again.

        Raises:
            Refused: ``unknown_stop`` (also if a newer stop took its place), ``moving`` or ``forbidden``.
        """
        return self._ask(build(Reset, stop=stop), Resumed)

    def sessions(self) -> tuple[SessionInfo, ...]:
        """Return the sessions of the daemon (operators).

        Raises:
            Refused: ``forbidden``, or the daemon does not know this (``unknown_type``).
        """
        return (self._ask(build(Sessions), SessionList)).sessions

    def kick(self, session: str, reason: str = "") -> None:
        """End a session; its robots play their plans to rest (operators).

        Raises:
            Refused: ``unknown_session`` or ``forbidden``.
        """
        self._ask(build(Kick, session=session, reason=reason), Kicked)

    def ping(self) -> float:
        """How long an answer takes, s."""
        start = monotonic()
        self._ask(Ping(time=start), Pong)
        return monotonic() - start

    def asset(self, name: str) -> bytes:
        """The asset of this SHA-256, as the description names it; fetched once, checked against its hash."""
        if name not in self._assets:
            download = Download(name)
            while (data := download.take(self._ask(build(Asset, **download.request()), Chunk))) is None:
                pass
            self._assets[name] = data
        return self._assets[name]

    def urdf(self, robot: str) -> str:
        """The robot's URDF."""
        return self.asset(self.robot(robot).urdf.hash).decode()

    def close(self) -> None:
        """Says bye and closes; leases end with it and robots come to rest."""
        try:
            self._write(self._session.bye())
        except ClientError:
            pass  # there is nobody left to say it to
        finally:
            self._stream.close()

    # --- waiting -------------------------------------------------------------------------------------------

    def _greet(self, name: str, role: Role, token: str | None) -> None:
        self._write(self._session.hello(name, role, token, SOFTWARE))
        self._wait(lambda: self._session.welcome, self.timeout, "a welcome")
        self.description = self._ask(Describe(), Description)

    def _ask(self, request: Request, kind: type[A]) -> A:
        number, data = self._session.ask(request)
        self._write(data)
        # In lock-step the answer may have to wait for the others' step.
        limit = None if self.welcome.lockstep else self.timeout
        try:
            return self._wait(
                lambda: self._session.pending.answer(number, kind), limit, f"an answer to {request.type}"
            )
        finally:
            self._session.pending.forget_answer(number)

    def _wait(self, poll: Callable[[], T | None], timeout: float | None, what: str) -> T:
        deadline = float("inf") if timeout is None else monotonic() + timeout
        self._write(self._session.kept())
        self._drain()
        while (found := poll()) is None:
            self._session.check()
            self._turn(deadline, f"{what} did not come within {timeout} s")
        return found

    def _turn(self, deadline: float, late: str) -> None:
        now = monotonic()
        if now >= deadline:
            raise TimedOut(f"{late}; is the server overloaded, or the network slow?")
        self._write(self._session.keepalive(now))
        self._session.check_silence(now, self.timeout)
        self._stream.wait(min(deadline, self._session.keepalive_due) - now, writing=False)
        self._drain()

    # --- the stream ----------------------------------------------------------------------------------------

    def _drain(self) -> None:
        for _ in range(_ROUNDS):
            if self._session.closed is not None:
                return
            try:
                data = self._stream.receive()
            except OSError as error:
                self._session.receive_eof(f"the connection broke ({error.strerror or error})")
                return
            if data is None:
                return
            if not data:
                self._session.receive_eof()
                return
            self._session.receive(data)
            if self._stream.emptied:
                return

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            try:
                sent = self._stream.send(left)
            except OSError as error:
                self._drain()  # the server may have said why
                self._session.receive_eof(f"the connection broke ({error.strerror or error})")
                self._session.check()
            if sent:
                left = left[sent:]
            else:
                self._make_room()
        if data:
            self._session.sent(monotonic())

    def _make_room(self) -> None:
        # Reading meanwhile keeps two peers with full buffers from waiting for each other.
        if not self._stream.wait(self.timeout, writing=True):
            self._session.receive_eof(f"the server has read nothing for {self.timeout:g} s")
        self._drain()
        self._session.check()


class Robot(RobotHandle):
    """A robot that this client holds; a context manager that gives it back."""

    def __init__(self, cell: Cell, lease: Lease) -> None:
        super().__init__(cell._session, lease)
        self._cell = cell

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.release()
        except ClientError:
            if error is None:
                raise

    def ticks(self, timeout: float | None = None) -> Iterator[Tick]:
        """Yields one tick per cycle of this robot's clock, always the newest: who is slow misses some.

        ``timeout`` bounds the wait for the next one, s; None: the cell's ``patience``, in lock-step no bound.

        Raises:
            LeaseLost: The robot is no longer this client's.
            RobotStopped: It was stopped.
            ConnectionLost: There is no connection any more.
            Refused: The server could not read an earlier message that nobody waited for.
        """
        if (missing := self._session.wanted(self.name)) is not None:
            self._cell._ask(missing, Subscribed)
        while True:
            limit = self._cell._clock_limit(timeout)
            self.tick = self._cell._wait(self._poll(), limit, f"a tick of {self.name}")
            yield self.tick

    def send(self, dq: Any, timeout: float | None = None) -> Verdict:
        """Asks for the increment ``dq`` (rad or m by joint) to the setpoint and waits for the verdict.

        Raises:
            Refused: The command could not be read, so that it has no verdict.
            Lost, ConnectionLost, TimedOut: As for ``ticks``.
        """
        seq, data = self._command(dq)
        self._session.pending.expect_verdict(seq)
        try:
            self._cell._write(data)
            limit = self._cell._verdict_limit(timeout)
            return self._cell._wait(lambda: self._session.pending.verdict(seq), limit, "a verdict")
        finally:
            self._session.pending.forget_verdict(seq)

    def post(self, dq: Any) -> int:
        """As ``send`` without waiting; gives the number that the verdict in ``verdicts`` will have."""
        seq, data = self._command(dq)
        self._cell._write(data)
        return seq

    def skip(self) -> None:
        """Lock-step: nothing from this client for this step. By the wall clock there is nothing to say."""
        self._cell._write(self._pass())

    def release(self) -> None:
        """Gives the lease back, if it is still held; the robot comes to rest."""
        if self.held:
            self._cell._ask(Release(robot=self.name, fence=self.lease.fence), Lease)
