"""What the handles of both shells share: all that needs no waiting."""

from collections.abc import Callable, Mapping
from typing import Any

from armgate.client.errors import BadArgument
from armgate.client.session import Session
from armgate.client.tick import Tick
from armgate.protocol.messages import Description, Lease, RobotDescription, State, Stopped, Verdict, Welcome

SOFTWARE = "armgate.client/python"


class CellHandle:
    """A connection to a cell.

    Attributes:
        timeout: How long an answer may take, s.
        patience: How long the robots' clock may stand still, s; in lock-step it may without limit.
        description: The cell: robots, joints, limits, bodies.
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
        assert self._session.welcome is not None  # there is no handle before it
        return self._session.welcome

    @property
    def stops(self) -> Mapping[int, Stopped]:
        """The stops in force that this client was told of, by id."""
        return self._session.holdings.stops

    @property
    def signals_dropped(self) -> int:
        """How many of this client's signals the server dropped because they came too fast."""
        return self._session.pending.signals_dropped

    def robot(self, name: str) -> RobotDescription:
        """One robot's description.

        Raises:
            BadArgument: The cell has no such robot.
        """
        for robot in self.description.robots:
            if robot.name == name:
                return robot
        known = ", ".join(robot.name for robot in self.description.robots)
        raise BadArgument(f"no robot {name}; the cell has {known}")

    def _poll_state(self, seen: int) -> Callable[[], tuple[int, State] | None]:
        return lambda: self._session.next_state(seen)

    def _clock_limit(self, timeout: float | None) -> float | None:
        """How long to wait for what depends on the robots' clock; None: as long as the server lives."""
        return timeout if timeout is not None or self.welcome.lockstep else self.patience

    def _verdict_limit(self, timeout: float | None) -> float | None:
        # By the wall clock a command is judged on arrival, in lock-step when all have had their say.
        return timeout if timeout is not None or self.welcome.lockstep else self.timeout


class RobotHandle:
    """A robot that this client holds.

    Attributes:
        name: Its name.
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
        """Whether the lease is in force, as far as is known here."""
        return self._session.closed is None and self._session.holdings.holds(self.name, self.lease.fence)

    def verdicts(self) -> list[Verdict]:
        """The verdicts of posted commands that came since the last call, in order.

        The newest 4096 are kept until they are asked for.
        """
        return self._session.pending.verdicts(self.name)

    def _command(self, dq: Any) -> tuple[int, bytes]:
        if self.tick is None:
            raise BadArgument("no tick was seen yet: send inside `for tick in robot.ticks()`")
        return self._session.command(self.name, self.lease.fence, self.tick.tick, dq)

    def _pass(self) -> bytes:
        if self.tick is None or self.tick.step is None:
            return b""
        self._session.holdings.check(self.name, self.lease.fence)
        return self._session.pass_step(self.tick.step)

    def _poll(self) -> Callable[[], Tick | None]:
        after = -1 if self.tick is None else self.tick.tick
        return lambda: self._session.next_tick(self.name, self.lease.fence, after)
