"""Blocking shell of the SDK: a plain socket, no thread. ``armgate.client.connect`` is defined here.

The SDK reads the socket only during a call, and sends pings while a call waits. A program that makes no call
for longer than the lease's time to live loses its leases. Use a handle in one thread at a time.
"""

from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from types import TracebackType
from typing import Any, Self, TypeVar

from armgate.client.asset import Download
from armgate.client.base import SOFTWARE, CellBase, RobotBase
from armgate.client.blocking_stream import Stream
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

_ROUNDS = 64
"""Largest number of reads in a row; then waiting calls check for their result, so a flood delays no tick."""

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
    """Connect to a daemon, send hello and request the description of its cell.

    Args:
        address: ``HOST:PORT``, or ``unix:PATH`` of a socket on this machine.
        name: Name of this client, visible to other clients; in lock-step the name of a participant.
        role: ``observer`` reads states, ``controller`` also moves robots, ``operator`` also resets stops and
            takes robots over.
        token: Token, if the daemon requires one.
        tls: TLS, if the daemon uses it: the file with its CA, True for the system's CAs, or an
            ``SSLContext``, see ``tls_context``.
        timeout: Timeout of the connection and of each answer, s.
        patience: Longest time for which the robots' clock may stand still before a wait for it ends, s.

    Raises:
        BadArgument: An argument is invalid, or the token would cross a network unencrypted.
        ConnectionLost: No daemon listens there, or (``Rejected``) the daemon rejects this client.
        TimedOut: The daemon sent no welcome in time.
    """
    context = context_of(tls)
    try:
        stream = Stream.open(address, timeout, context)
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


class Cell(CellBase):
    """Connection to a cell; a context manager that closes it."""

    def __init__(self, stream: Stream, session: Session, timeout: float, patience: float) -> None:
        super().__init__(session, timeout, patience)
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- the cell ------------------------------------------------------------------------------------------

    def acquire(self, robot: str, *, speed: float = 1.0, takeover: bool = False) -> "Robot":
        """Acquire the lease of a robot; the result is a context manager that releases it.

        Args:
            robot: Name of the robot.
            speed: Tighter speed bound, a share of the cell's.
            takeover: Take the robot over from its holder (operators only).

        Raises:
            Refused: ``leased``, ``stopped``, ``unknown_robot`` or ``forbidden``.
        """
        lease = self._ask(build(Acquire, robot=robot, speed=speed, takeover=takeover), Lease)
        return Robot(self, lease)

    def subscribe(
        self, every: int = 1, robots: Iterable[str] | None = None, fields: Iterable[str] | None = None
    ) -> Subscribed:
        """Subscribe to states at every n-th tick of some robots.

        Args:
            every: Number of ticks from one state to the next; 0 ends the subscription.
            robots: Names of the robots; None: all.
            fields: Names of the fields of each entry; None: all.

        Raises:
            Refused: ``unknown_robot`` or ``unknown_field``.
        """
        return self._ask(self._subscription(every, robots, fields), Subscribed)

    def states(self, timeout: float | None = None, backlog: int = 1) -> Iterator[State]:
        """Yield states; a slow program misses some.

        Without a subscription, subscribe to all robots at every tick.

        Args:
            timeout: Timeout of the wait for the next state, s; None: ``patience``, unlimited in lock-step.
            backlog: Number of states that are queued in order; 1: yield the newest state only.
        """
        if self._session.subscription is None:
            self.subscribe()
        self._session.keep_states(backlog)
        seen = 0
        while True:
            limit = self._clock_limit(timeout)
            seen, state = self._wait(self._poll_state(seen), limit, "a state")
            yield state

    def skip(self) -> None:
        """End the newest step without a command, in lock-step; for participants that hold no robot."""
        self._write(self._session.skip())

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Share a number or a short vector with all clients, without waiting for the answer.

        Args:
            name: Name of the signal.
            value: The number or numbers.
            more: Delay the signal and send it together with the next message, such as a command.

        Raises:
            Refused: An earlier signal was refused. Signals that were sent too fast are only counted, see
                ``signals_dropped``.
        """
        if not more:  # a delayed signal reads and writes nothing, so that many of them cost little
            self._receive()
        self._write(self._session.signal(name, value, more=more))

    def stop(self, robot: str | None = None, reason: str = "") -> Stopped:
        """Stop one robot, or all; every role may stop.

        Args:
            robot: Name of the robot; None: all robots.
            reason: Reason, shown to all clients.

        Returns:
            The stop with its id, for ``reset``.

        Raises:
            Refused: ``unknown_robot``.
        """
        return self._ask(build(Stop, robot=robot, reason=reason), Stopped)

    def reset(self, stop: int) -> Resumed:
        """Lift a stop (operators only); its robots must be acquired again.

        Raises:
            Refused: ``unknown_stop`` (also if a newer stop replaced it), ``moving`` or ``forbidden``.
        """
        return self._ask(build(Reset, stop=stop), Resumed)

    def sessions(self) -> tuple[SessionInfo, ...]:
        """Return the sessions of the daemon (operators only).

        Raises:
            Refused: ``forbidden``, or ``unknown_type`` if the daemon does not support this.
        """
        return self._ask(build(Sessions), SessionList).sessions

    def kick(self, session: str, reason: str = "") -> None:
        """End a session (operators only); its robots play their plans to rest.

        Raises:
            Refused: ``unknown_session`` or ``forbidden``.
        """
        self._ask(build(Kick, session=session, reason=reason), Kicked)

    def ping(self) -> float:
        """Measure and return the round-trip time to the daemon, s."""
        start = monotonic()
        self._ask(Ping(time=start), Pong)
        return monotonic() - start

    def asset(self, name: str) -> bytes:
        """Return an asset of the description; download and verify it once.

        Args:
            name: SHA-256 of the asset, in hexadecimal digits.

        Raises:
            Refused: ``unknown_asset``.
            ConnectionLost: The server sent other data.
        """
        if name not in self._assets:
            download = Download(name)
            while (data := download.take(self._ask(build(Asset, **download.request()), Chunk))) is None:
                pass
            self._assets[name] = data
        return self._assets[name]

    def urdf(self, robot: str) -> str:
        """Return the URDF of a robot."""
        return self.asset(self.robot(robot).urdf.hash).decode()

    def close(self) -> None:
        """Send bye and close the connection; its leases end, and their robots come to rest."""
        try:
            self._write(self._session.bye())
        except ClientError:
            pass  # the connection has ended already
        finally:
            self._stream.close()

    # --- waiting -------------------------------------------------------------------------------------------

    def _greet(self, name: str, role: Role, token: str | None) -> None:
        self._write(self._session.hello(name, role, token, SOFTWARE))
        self._wait(lambda: self._session.welcome, self.timeout, "a welcome")
        self.description = self._ask(Describe(), Description)

    def _ask(self, request: Request, kind: type[A]) -> A:
        number, data = self._session.ask(request)
        poll = self._session.pending.answer
        try:
            self._write(data)
            return self._wait(
                lambda: poll(number, kind), self._answer_limit(), f"an answer to {request.type}"
            )
        finally:
            self._session.pending.forget_answer(number)

    def _wait(self, poll: Callable[[], T | None], timeout: float | None, what: str) -> T:
        deadline = float("inf") if timeout is None else monotonic() + timeout
        self._write(self._session.delayed())
        self._receive()
        while (found := poll()) is None:
            self._write(self._keepalive(deadline, what, timeout))
            self._stream.wait(self._pause(deadline), writing=False)
            self._receive()
        return found

    # --- the stream ----------------------------------------------------------------------------------------

    def _receive(self) -> None:
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
        if not data:
            return
        left = memoryview(data)
        while left:
            try:
                sent = self._stream.send(left)
            except OSError as error:
                self._receive()  # the server may have sent the reason
                self._session.receive_eof(f"the connection broke ({error.strerror or error})")
                self._session.check()
            if sent:
                left = left[sent:]
            else:
                self._make_room()
        self._session.sent(monotonic())

    def _make_room(self) -> None:
        # Reading meanwhile prevents a deadlock of two peers with full buffers.
        if not self._stream.wait(self.timeout, writing=True):
            self._session.receive_eof(f"the server has read nothing for {self.timeout:g} s")
        self._receive()
        self._session.check()


class Robot(RobotBase):
    """Robot whose lease this client holds; a context manager that releases it."""

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
        """Yield the newest tick of this robot's clock, one per cycle; a slow program misses some.

        Args:
            timeout: Timeout of the wait for the next tick, s; None: the cell's ``patience``, unlimited in
                lock-step.

        Raises:
            LeaseLost: The lease ended.
            RobotStopped: The robot was stopped.
            ConnectionLost: The connection ended.
            TimedOut: No tick arrived in time.
            Refused: The server refused an earlier message, and no call waited for its answer.
        """
        if (missing := self._session.missing_subscription(self.name)) is not None:
            self._cell._ask(missing, Subscribed)
        while True:
            limit = self._cell._clock_limit(timeout)
            self.tick = self._cell._wait(self._poll(), limit, f"a tick of {self.name}")
            yield self.tick

    def send(self, dq: Any, timeout: float | None = None) -> Verdict:
        """Request the increment ``dq`` (rad or m by joint) to the setpoint, and return the verdict.

        Args:
            dq: Increment at the next tick, one number per joint.
            timeout: Timeout of the verdict, s; None: the cell's ``timeout``, unlimited in lock-step.

        Raises:
            Refused: The command could not be read, so it has no verdict.
            Lost: The lease ended, or the robot was stopped.
            ConnectionLost: The connection ended.
            TimedOut: No verdict arrived in time.
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
        """Send a command like ``send``, without waiting; return the ``seq`` of its verdict."""
        seq, data = self._command(dq)
        self._cell._write(data)
        return seq

    def skip(self) -> None:
        """End this step without a command, in lock-step; do nothing by the wall clock."""
        self._cell._write(self._pass())

    def release(self) -> None:
        """Release the lease, if it is still held; the robot comes to rest."""
        if self.held:
            self._cell._ask(Release(robot=self.name, fence=self.lease.fence), Lease)
