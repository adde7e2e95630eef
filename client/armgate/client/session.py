"""The client's side of a conversation, without I/O: what the asyncio and the blocking shell have in common.

A shell writes the bytes that the methods return, hands what it reads to :meth:`Session.receive`, and then
polls (``pending.answer``, ``pending.verdict``, ``next_tick`` …) until it gets something else than None.
Nothing here waits or knows a socket; times are handed in, s, of any clock that does not go back.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar

from armgate.client.errors import BadArgument, ClientError, ConnectionLost, Rejected, TimedOut
from armgate.client.holdings import Holdings
from armgate.client.pending import Pending
from armgate.client.tick import Tick
from armgate.protocol import DIALECTS, Connection, Dialect, ErrorCode, LocalProtocolError, Refusal, Side
from armgate.protocol.messages import (
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

KEEPALIVE_SHARE = 1 / 3
"""A sign of life is given after this share of a lease's time to live."""

_CAPABILITIES = ("stop.replaces",)
"""Capabilities named in hello: this client resets only stops that it knows to be in force."""


class Session:
    """One client's conversation with a daemon.

    Attributes:
        pending: What is waited for.
        holdings: What is held.
        welcome: The server's welcome, None before.
        state: The newest state of all, None before the first.
        states: How many states have come.
        subscription: What is subscribed, None for nothing.
        closed: Why nothing more can be said, None while the connection stands.
    """

    def __init__(self, dialects: Sequence[Dialect] = DIALECTS) -> None:
        self.pending = Pending()
        self.holdings = Holdings()
        self.welcome: Welcome | None = None
        self.state: State | None = None
        self.states = 0
        self.subscription: Subscribed | None = None
        self.closed: ClientError | None = None
        self._connection = Connection(Side.CLIENT, dialects)
        self._newest: dict[str, State] = {}
        # The tick for which each robot's newest command was judged: its slot is taken.
        self._slot: dict[str, int] = {}
        self._recent: deque[State] = deque(maxlen=1)
        self._ids = 0
        self._seq = 0
        # Said, but not yet handed to the shell: it goes with what is said next.
        self._kept = b""
        self._sent = 0.0
        self._pinged: float | None = None

    # --- what is said --------------------------------------------------------------------------------------

    def hello(self, name: str, role: Role, token: str | None, software: str) -> bytes:
        """The first message; the shell then waits for ``welcome``."""
        own: dict[str, Any] = {} if token is None else {"token": token}
        own |= {"versions": self._connection.versions, "capabilities": _CAPABILITIES}
        return self._say(build(Hello, name=name, role=role, software=software, **own))

    def ask(self, request: Request) -> tuple[int, bytes]:
        """A request: the number by which ``pending.answer`` finds the answer, and its bytes."""
        self._ids += 1
        data = self._say(request.model_copy(update={"id": self._ids}))
        self.pending.expect_answer(self._ids)
        return self._ids, data

    def command(self, robot: str, fence: int, tick: int, dq: Iterable[Any]) -> tuple[int, bytes]:
        """A command: the number by which ``pending.verdict`` finds the judgement, and its bytes.

        The increment is sent as it is: what is wrong with it is for the server to say. Numbers run through
        the whole session, so that an error that names nothing else is about one command.
        """
        self.holdings.check(robot, fence)
        fields: dict[str, Any] = {
            "robot": robot,
            "fence": fence,
            "seq": self._seq + 1,
            "tick": tick,
            "dq": _increment(dq),
        }
        data = self._say(Command.model_construct(**fields))
        self._seq += 1
        return self._seq, data

    def pass_step(self, step: int) -> bytes:
        """Lock-step: nothing more for this step."""
        return self._say(Pass(step=step))

    def skip(self) -> bytes:
        """As ``pass_step`` for the step of the newest state; nothing by the wall clock or before a state."""
        step = None if self.state is None else self.state.step
        return b"" if step is None else self.pass_step(step)

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> bytes:
        """A signal; nobody waits for the answer. With ``more`` it goes with what is said next.

        Raises:
            Refused: An earlier signal was refused.
        """
        self.pending.complain_of_signals()
        self._ids += 1
        data = self._say(build(Signal, name=name, value=_vector(name, value), id=self._ids))
        self.pending.expect_signaled(self._ids)
        if more:
            self._kept = data
            return b""
        return data

    def wanted(self, robot: str) -> Subscribe | None:
        """The subscription that is still missing before this robot's ticks can be followed."""
        now = self.subscription
        if now is None or not now.every:
            return Subscribe(every=1, robots=(robot,))
        if robot in now.robots:
            return None
        return Subscribe(every=now.every, robots=(*now.robots, robot), fields=now.fields)

    def kept(self) -> bytes:
        """What was kept for what is said next, for a shell that is about to wait."""
        data, self._kept = self._kept, b""
        return data

    def bye(self, reason: str = "") -> bytes:
        """The last message; nothing where nothing can be said any more."""
        if self.closed is not None:
            return b""
        self.closed = ConnectionLost("this client has closed the connection; connect again")
        return self.kept() + self._connection.send(Bye(reason=reason[:512]))

    def keepalive(self, now: float) -> bytes:
        """A ping where nothing was sent for a third of a lease's time to live, else nothing."""
        if self.closed is not None or now < self.keepalive_due:
            return b""
        if self._pinged is None:
            self._pinged = now
        return self._say(Ping(time=now))

    @property
    def keepalive_due(self) -> float:
        """When the next sign of life is due; an observer's tells it whether the server still lives."""
        if self.welcome is None:
            return float("inf")
        ttl = self.holdings.ttl
        return self._sent + KEEPALIVE_SHARE * (self.welcome.limits.lease_ttl if ttl is None else ttl)

    def sent(self, now: float) -> None:
        """The shell has written something."""
        self._sent = now

    # --- what is heard -------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Takes bytes from the server."""
        self._pinged = None
        for item in self._connection.receive(data):
            if isinstance(item, Refusal):
                self._unreadable(item)
            else:
                self._take(item)

    def receive_eof(self, why: str = "the server closed the connection") -> None:
        """The server sends no more."""
        self._connection.receive_eof()
        if self.welcome is None:
            text = (
                f"{why} without a welcome; does it ask for TLS (tls=…, --ca), or for a certificate (--cert)?"
            )
        else:
            text = f"{why}; robots held come to rest; connect again when the server runs"
        self._close(ConnectionLost(text))

    def check(self) -> None:
        """Raises why the connection is closed, if it is."""
        if self.closed is not None:
            raise self.closed

    def check_silence(self, now: float, timeout: float) -> None:
        """Raises ``TimedOut`` if a ping has been without any reaction for longer than ``timeout``."""
        if self._pinged is not None and now - self._pinged > timeout:
            raise TimedOut(f"the server has been silent for {timeout:g} s; close and connect again")

    def keep_states(self, count: int) -> None:
        """Keeps up to this many states for ``next_state``; at first only the newest."""
        self._recent = deque(self._recent, maxlen=max(count, 1))

    def next_state(self, seen: int) -> tuple[int, State] | None:
        """The oldest kept state after the first ``seen`` ones, and which one it is, from 1; else None."""
        self.pending.complain()
        dropped = self.states - len(self._recent)
        index = max(seen - dropped, 0)
        return (dropped + index + 1, self._recent[index]) if index < len(self._recent) else None

    def next_tick(self, robot: str, fence: int, after: int) -> Tick | None:
        """The newest tick of a robot that is held, if it is later than ``after`` and can be answered.

        A command for the tick after it may have been judged already, where the state that the command was
        based on came late: one more would be refused.

        Raises:
            Lost: The robot is no longer held with this fence.
        """
        self.holdings.check(robot, fence)
        self.pending.complain()
        state = self._newest.get(robot)
        if state is None or state.tick <= after or state.tick < self._slot.get(robot, 0):
            return None
        return Tick(robot, state)

    # --- one handler for each message ----------------------------------------------------------------------

    def _take(self, message: Message) -> None:
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
            self._slot[verdict.robot] = verdict.target
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
        self._close(ConnectionLost(f"the server said goodbye{why}; connect again when it runs"))

    _HANDLERS: ClassVar[dict[type[Message], Callable[[Any, Any], None]]] = {
        Welcome: _take_welcome,
        State: _take_state,
        Subscribed: _take_subscribed,
        Error: _take_error,
        Bye: _take_bye,
        Verdict: _take_verdict,
        Lease: lambda self, lease: self.holdings.take_lease(lease),
        Stopped: lambda self, stopped: self.holdings.take_stopped(stopped),
        Resumed: lambda self, resumed: self.holdings.take_resumed(resumed),
    }

    def _unreadable(self, refusal: Refusal) -> None:
        # A type that this version does not know may be left out; a known one that cannot be read may not:
        # somebody may wait for it.
        if refusal.fatal or refusal.error.code != ErrorCode.UNKNOWN_TYPE:
            text = f"the server sent what cannot be read ({refusal.error.code}: {refusal.error.text})"
            self._close(ConnectionLost(f"{text}; compare the versions of client and server"))

    def _close(self, why: ClientError) -> None:
        if self.closed is None:
            self.closed = why

    def _say(self, message: Message) -> bytes:
        self.check()
        try:
            return self.kept() + self._connection.send(message)
        except LocalProtocolError as error:
            raise BadArgument(error.text) from error


def build(model: type[Message], **fields: Any) -> Any:
    """A message from a caller's arguments.

    Raises:
        BadArgument: An argument has the wrong form; the text names it.
    """
    try:
        return model(**fields)
    except ValueError as error:
        problem = error.errors()[0] if hasattr(error, "errors") else {"loc": (), "msg": str(error)}
        where = ".".join(str(key) for key in problem["loc"])
        raise BadArgument(f"{where}: {problem['msg']}") from None


def _increment(dq: Iterable[Any]) -> tuple[Any, ...]:
    values = dq.tolist() if hasattr(dq, "tolist") else dq
    try:
        return tuple(value.item() if hasattr(value, "item") else value for value in values)
    except TypeError:
        raise BadArgument(f"dq: expected a sequence of numbers, got {type(dq).__name__}") from None


def _vector(name: str, value: Iterable[float] | float) -> tuple[float, ...]:
    try:
        return tuple(float(x) for x in value) if isinstance(value, Iterable) else (float(value),)
    except (TypeError, ValueError):
        raise BadArgument(f"signal {name}: expected a number or numbers, got {value!r:.60}") from None
