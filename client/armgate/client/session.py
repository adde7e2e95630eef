"""Client side of a connection, without I/O: the core of the asyncio and the blocking shell.

A shell writes the bytes that the methods return, passes the bytes that it reads to :meth:`Session.receive`,
and polls (``pending.answer``, ``pending.verdict``, ``next_tick``, …) until the result is not None. The module
neither waits nor uses a socket; times are arguments, s, of any monotonic clock.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import isfinite
from typing import Any, ClassVar, Protocol

from armgate.client.errors import BadArgument, ClientError, ConnectionLost, Rejected, TimedOut
from armgate.client.leases import HeldLeases
from armgate.client.pending import Pending
from armgate.client.tick import Tick
from armgate.protocol import DIALECTS, Connection, Dialect, ErrorCode, LocalProtocolError, Refusal, Side
from armgate.protocol.messages import (
    MAX_SIGNAL,
    Answer,
    Bye,
    Command,
    Error,
    Hello,
    Lease,
    Message,
    Pass,
    Ping,
    Request,
    Resumed,
    Role,
    Signal,
    State,
    Stopped,
    Subscribe,
    Subscribed,
    Verdict,
    Welcome,
)
from armgate.protocol.unvalidated import unvalidated

KEEPALIVE_SHARE = 1 / 3
"""Share of a lease's time to live after which a ping is sent if nothing else was sent."""

CAPABILITIES = ("stop.replaces",)
"""Capabilities in hello: this client resets a stop only by the id that is in force."""


_IN_COMMANDS = {"robot", "fence", "seq", "tick", "dq"}
"""Fields of a command that count as set."""


class MessageSender(Protocol):
    """Sending side of a session that exchanges messages as objects, such as that of a program in a world."""

    def send(self, message: Message) -> bytes:
        """Send a message, and return no bytes.

        Raises:
            LocalProtocolError: The message is invalid.
        """


class Session:
    """Protocol session of one client with a daemon.

    Args:
        dialects: Supported versions of the protocol.
        sender: Sends messages as objects instead of as bytes; the shell then passes received messages to
            `take`.

    Attributes:
        pending: Messages that await an answer.
        leases: Leases held, and stops in force.
        welcome: The server's welcome; None until it arrives.
        state: The newest state of any robot; None before the first.
        states: Number of states received.
        subscription: The subscription in force; None if there is none.
        closed: Exception with the reason for which the connection ended; None while it is open.
    """

    def __init__(self, dialects: Sequence[Dialect] = DIALECTS, sender: MessageSender | None = None) -> None:
        self.pending = Pending()
        self.leases = HeldLeases()
        self.welcome: Welcome | None = None
        self.state: State | None = None
        self.states = 0
        self.subscription: Subscribed | None = None
        self.closed: ClientError | None = None
        self._connection = Connection(Side.CLIENT, dialects)
        self._sender: MessageSender = sender or self._connection
        self._newest: dict[str, State] = {}
        # Target tick of each robot's newest verdict: this tick already has its command.
        self._target: dict[str, int] = {}
        self._recent: deque[State] = deque(maxlen=1)
        self._ids = 0
        self._seq = 0
        # Names of signals that are valid.
        self._names: set[str] = set()
        # Messages that are encoded but not returned to the shell yet: they are sent with the next message.
        self._delayed = b""
        self._sent = 0.0
        self._pinged: float | None = None

    # --- sending -------------------------------------------------------------------------------------------

    def hello(self, name: str, role: Role, token: str | None, software: str) -> bytes:
        """Return the first message; the shell then waits for ``welcome``."""
        own: dict[str, Any] = {} if token is None else {"token": token}
        own |= {"versions": self._connection.versions, "capabilities": CAPABILITIES}
        return self._send(build(Hello, name=name, role=role, software=software, **own))

    def ask(self, request: Request) -> tuple[int, bytes]:
        """Return the number for ``pending.answer`` and the bytes of a request."""
        self._ids += 1
        data = self._send(request.model_copy(update={"id": self._ids}))
        self.pending.expect_answer(self._ids)
        return self._ids, data

    def command(self, robot: str, fence: int, tick: int, dq: Iterable[Any]) -> tuple[int, bytes]:
        """Return the number for ``pending.verdict`` and the bytes of a command.

        The increment is sent unchanged: the server validates it. Numbers increase over all robots of the
        session, so that an error with a ``seq`` identifies one command.
        """
        self.leases.check(robot, fence)
        fields = {
            "type": "command",
            "robot": robot,
            "fence": fence,
            "seq": self._seq + 1,
            "tick": tick,
            "dq": _increment(dq),
            "deadline": None,
            "horizon": None,
        }
        data = self._send(unvalidated(Command, fields, _IN_COMMANDS))
        self._seq += 1
        return self._seq, data

    def pass_step(self, step: int) -> bytes:
        """Return a pass for a step in lock-step."""
        return self._send(Pass(step=step))

    def skip(self) -> bytes:
        """Return a pass for the newest state's step; empty by the wall clock and before the first state."""
        step = None if self.state is None else self.state.step
        return b"" if step is None else self.pass_step(step)

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> bytes:
        """Return the bytes of a signal, whose answer is not awaited; with ``more``, delay them.

        Raises:
            Refused: An earlier signal was refused.
        """
        self.pending.raise_refused_signal()
        self._ids += 1
        data = self._send(self._signal(name, _vector(name, value)))
        self.pending.expect_signaled(self._ids)
        if more:
            self._delayed = data
            return b""
        return data

    def _signal(self, name: str, value: tuple[float, ...]) -> Signal:
        """Return a signal; a name is validated once, as controllers share the same ones at every tick."""
        if type(name) is str and name in self._names and _fits_signal(value):
            fields = {"type": "signal", "id": self._ids, "name": name, "value": value}
            return unvalidated(Signal, fields)
        signal: Signal = build(Signal, name=name, value=value, id=self._ids)
        self._names.add(name)
        return signal

    def missing_subscription(self, robot: str) -> Subscribe | None:
        """Return the subscription required for this robot's ticks; None if the present one includes them."""
        now = self.subscription
        if now is None or not now.every:
            return Subscribe(every=1, robots=(robot,))
        if robot in now.robots:
            return None
        return Subscribe(every=now.every, robots=(*now.robots, robot), fields=now.fields)

    def delayed(self) -> bytes:
        """Return the delayed bytes, for a shell that is about to wait."""
        data, self._delayed = self._delayed, b""
        return data

    def bye(self, reason: str = "") -> bytes:
        """Return the last message; empty if the connection has ended already."""
        if self.closed is not None:
            return b""
        self.closed = ConnectionLost("this client has closed the connection; connect again")
        return self.delayed() + self._sender.send(Bye(reason=reason[:512]))

    def keepalive(self, now: float) -> bytes:
        """Return a ping if nothing was sent for a third of a lease's time to live, else no bytes."""
        if self.closed is not None or now < self.keepalive_due:
            return b""
        if self._pinged is None:
            self._pinged = now
        return self._send(Ping(time=now))

    @property
    def keepalive_due(self) -> float:
        """Time at which the next ping is due; an observer also pings, to detect a lost server."""
        if self.welcome is None:
            return float("inf")
        ttl = self.leases.ttl
        return self._sent + KEEPALIVE_SHARE * (self.welcome.limits.lease_ttl if ttl is None else ttl)

    def sent(self, now: float) -> None:
        """Record the time at which the shell wrote bytes."""
        self._sent = now

    # --- receiving -----------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Handle bytes from the server."""
        self._pinged = None
        for item in self._connection.receive(data):
            if isinstance(item, Refusal):
                self._take_refusal(item)
            else:
                self.take(item)

    def receive_eof(self, why: str = "the server closed the connection") -> None:
        """Close the session at the end of the server's stream."""
        self._connection.receive_eof()
        if self.welcome is None:
            text = f"{why} without a welcome; does it require TLS (tls=…, --ca), or a certificate (--cert)?"
        else:
            text = f"{why}; the robots held come to rest; connect again when the server runs"
        self._close(ConnectionLost(text))

    def check(self) -> None:
        """Raise the exception in ``closed`` if the connection has ended."""
        if self.closed is not None:
            raise self.closed

    def check_silence(self, now: float, timeout: float) -> None:
        """Raise ``TimedOut`` if the server has sent nothing for longer than ``timeout`` after a ping."""
        if self._pinged is not None and now - self._pinged > timeout:
            raise TimedOut(f"the server has been silent for {timeout:g} s; close and connect again")

    def keep_states(self, count: int) -> None:
        """Queue up to this many states for ``next_state``; by default only the newest."""
        self._recent = deque(self._recent, maxlen=max(count, 1))

    def next_state(self, seen: int) -> tuple[int, State] | None:
        """Return number (from 1) and state of the oldest queued state after number ``seen``, if any."""
        self.pending.raise_unawaited()
        dropped = self.states - len(self._recent)
        index = max(seen - dropped, 0)
        return (dropped + index + 1, self._recent[index]) if index < len(self._recent) else None

    def next_tick(self, robot: str, fence: int, after: int) -> Tick | None:
        """Return the newest tick of a held robot if it is later than ``after`` and still lacks a command.

        A command that was based on an earlier state and arrived late may already have its verdict for the
        next tick. A second command for that tick would be refused.

        Raises:
            Lost: The robot is no longer held with this fence.
        """
        self.leases.check(robot, fence)
        self.pending.raise_unawaited()
        state = self._newest.get(robot)
        if state is None or state.tick <= after or state.tick < self._target.get(robot, 0):
            return None
        return Tick(robot, state)

    # --- one handler per message; a message without one is an answer, or belongs to a later version --------

    def take(self, message: Message) -> None:
        """Handle a message from the server."""
        handler = self._HANDLERS.get(type(message))
        if handler is not None:
            handler(self, message)
        if isinstance(message, Answer) and message.re is not None:
            self.pending.take_answer(message)

    def _take_welcome(self, welcome: Welcome) -> None:
        self.welcome = welcome

    def _take_state(self, state: State) -> None:
        self.state = self._newest[state.robot] = state
        self._recent.append(state)
        self.states += 1

    def _take_verdict(self, verdict: Verdict) -> None:
        if verdict.target is not None:
            self._target[verdict.robot] = verdict.target
        self.pending.take_verdict(verdict)

    def _take_subscribed(self, subscribed: Subscribed) -> None:
        self.subscription = subscribed

    def _take_error(self, error: Error) -> None:
        if error.fatal:
            self._close(Rejected(error))
        else:
            self.pending.take_error(error)

    def _take_bye(self, bye: Bye) -> None:
        why = f" ({bye.reason})" if bye.reason else ""
        self._close(ConnectionLost(f"the server ended the connection{why}; connect again when it runs"))

    _HANDLERS: ClassVar[dict[type[Message], Callable[[Any, Any], None]]] = {
        Welcome: _take_welcome,
        State: _take_state,
        Subscribed: _take_subscribed,
        Error: _take_error,
        Bye: _take_bye,
        Verdict: _take_verdict,
        Lease: lambda self, lease: self.leases.take_lease(lease),
        Stopped: lambda self, stopped: self.leases.take_stopped(stopped),
        Resumed: lambda self, resumed: self.leases.take_resumed(resumed),
    }

    def _take_refusal(self, refusal: Refusal) -> None:
        # A message of an unknown type is ignored. An unreadable message of a known type is not: a call may
        # wait for it.
        if refusal.fatal or refusal.error.code != ErrorCode.UNKNOWN_TYPE:
            text = f"the server sent an unreadable message ({refusal.error.code}: {refusal.error.text})"
            self._close(ConnectionLost(f"{text}; compare the versions of client and server"))

    def _close(self, why: ClientError) -> None:
        if self.closed is None:
            self.closed = why

    def _send(self, message: Message) -> bytes:
        if self.closed is not None:
            raise self.closed
        try:
            data = self._sender.send(message)
        except LocalProtocolError as error:
            raise BadArgument(error.text) from error
        return self.delayed() + data


def build(model: type[Message], **fields: Any) -> Any:
    """Return a message made of a caller's arguments.

    Raises:
        BadArgument: An argument is invalid; the text names it.
    """
    try:
        return model(**fields)
    except ValueError as error:
        problem = error.errors()[0] if hasattr(error, "errors") else {"loc": (), "msg": str(error)}
        where = ".".join(str(key) for key in problem["loc"])
        raise BadArgument(f"{where}: {problem['msg']}") from None


def _fits_signal(value: tuple[float, ...]) -> bool:
    """Return True if the numbers are valid as a signal's value."""
    return 0 < len(value) <= MAX_SIGNAL and all(map(isfinite, value))


def _increment(dq: Iterable[Any]) -> tuple[Any, ...]:
    values = dq.tolist() if hasattr(dq, "tolist") else dq
    try:
        return tuple([value if type(value) is float else _number(value) for value in values])
    except TypeError:
        raise BadArgument(f"dq: expected a sequence of numbers, got {type(dq).__name__}") from None


def _number(value: Any) -> Any:
    """Return a number of numpy as one of Python; anything else unchanged."""
    return value.item() if hasattr(value, "item") else value


def _vector(name: str, value: Iterable[float] | float) -> tuple[float, ...]:
    try:
        return tuple(map(float, value)) if hasattr(value, "__iter__") else (float(value),)
    except (TypeError, ValueError, OverflowError):
        raise BadArgument(f"signal {name}: expected a number or numbers, got {value!r:.60}") from None
