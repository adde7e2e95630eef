"""Shared part of the handles of both shells: everything that does not wait."""

from collections.abc import Callable, Iterable, Mapping
from time import monotonic
from typing import Any

from armgate.client.errors import BadArgument, TimedOut
from armgate.client.session import Session, build
from armgate.client.tick import Tick
from armgate.protocol.messages import (
    Description,
    Lease,
    RobotDescription,
    State,
    Stopped,
    Subscribe,
    Verdict,
    Welcome,
)

SOFTWARE = "armgate.client/python"


class CellBase:
    """Connection to a cell.

    Attributes:
        timeout: Timeout of an answer, s.
        patience: Longest time for which the robots' clock may stand still, s; unlimited in lock-step.
        description: Description of the cell: robots, joints, limits, bodies.
    """

    description: Description

    def __init__(self, session: Session, timeout: float, patience: float) -> None:
        self.timeout = timeout
        self.patience = patience
        self._session = session
        self._assets: dict[str, bytes] = {}

    @property
    def welcome(self) -> Welcome:
        """The server's welcome: version, session id, role, limits."""
        assert self._session.welcome is not None  # a handle exists only after the welcome
        return self._session.welcome

    @property
    def state(self) -> State | None:
        """The newest state; None before the first, see ``subscribe``."""
        self._receive()
        return self._session.state

    @property
    def stops(self) -> Mapping[int, Stopped]:
        """The stops in force by id, as far as this client was notified."""
        return self._session.leases.stops

    @property
    def signals_dropped(self) -> int:
        """Number of this client's signals that the server dropped because they arrived too fast."""
        return self._session.pending.signals_dropped

    def robot(self, name: str) -> RobotDescription:
        """Return the description of one robot.

        Raises:
            BadArgument: The cell has no such robot.
        """
        for robot in self.description.robots:
            if robot.name == name:
                return robot
        known = ", ".join(robot.name for robot in self.description.robots)
        raise BadArgument(f"no robot {name}; the cell has {known}")

    def _receive(self) -> None:
        """Pass bytes that have arrived to the session, in a shell whose stream does not do so by itself."""

    def _subscription(
        self, every: int, robots: Iterable[str] | None, fields: Iterable[str] | None
    ) -> Subscribe:
        chosen = None if robots is None else tuple(robots)
        shown = None if fields is None else tuple(fields)
        subscribe: Subscribe = build(Subscribe, every=every, robots=chosen, fields=shown)
        return subscribe

    # --- waiting: the shells poll, send the bytes of `_keepalive`, and wait for the time of `_pause` --------

    def _poll_state(self, seen: int) -> Callable[[], tuple[int, State] | None]:
        return lambda: self._session.next_state(seen)

    def _keepalive(self, deadline: float, what: str, timeout: float | None) -> bytes:
        """Return a ping if one is due, else no bytes.

        Raises:
            ConnectionLost: The connection ended.
            TimedOut: The deadline has passed, or the server is silent.
        """
        self._session.check()
        now = monotonic()
        if now >= deadline:
            text = f"{what} did not arrive within {timeout} s"
            raise TimedOut(f"{text}; is the server overloaded, or the network slow?")
        self._session.check_silence(now, self.timeout)
        return self._session.keepalive(now)

    def _pause(self, deadline: float) -> float:
        """Return the time until the deadline or the next ping, s."""
        return min(deadline, self._session.keepalive_due) - monotonic()

    def _answer_limit(self) -> float | None:
        # In lock-step an answer may have to wait for the other participants' step.
        return None if self.welcome.lockstep else self.timeout

    def _clock_limit(self, timeout: float | None) -> float | None:
        """Return the timeout of an event on the robots' clock; None: unlimited while the server answers."""
        return timeout if timeout is not None or self.welcome.lockstep else self.patience

    def _verdict_limit(self, timeout: float | None) -> float | None:
        # By the wall clock a command is decided on arrival, in lock-step at the end of the step.
        return timeout if timeout is not None or self.welcome.lockstep else self.timeout


class RobotBase:
    """Robot whose lease this client holds.

    Attributes:
        name: Name of the robot.
        lease: The lease: fence, time to live, speed bound.
        tick: The tick that was yielded last, None before the first.
    """

    def __init__(self, session: Session, lease: Lease) -> None:
        self.name = lease.robot
        self.lease = lease
        self.tick: Tick | None = None
        self._session = session

    @property
    def held(self) -> bool:
        """True if the lease is in force, as far as this client was notified."""
        return self._session.closed is None and self._session.leases.holds(self.name, self.lease.fence)

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts on posted commands that arrived since the last call, in order.

        At most the newest 4096 are kept between two calls.
        """
        return self._session.pending.verdicts(self.name)

    def _command(self, dq: Any) -> tuple[int, bytes]:
        if self.tick is None:
            raise BadArgument("no tick was received yet: send inside `for tick in robot.ticks()`")
        return self._session.command(self.name, self.lease.fence, self.tick.tick, dq)

    def _pass(self) -> bytes:
        if self.tick is None or self.tick.step is None:
            return b""
        self._session.leases.check(self.name, self.lease.fence)
        return self._session.pass_step(self.tick.step)

    def _poll(self) -> Callable[[], Tick | None]:
        after = -1 if self.tick is None else self.tick.tick
        return lambda: self._session.next_tick(self.name, self.lease.fence, after)
