"""State of the cell at one tick of a robot."""

from collections.abc import Mapping
from dataclasses import dataclass

from armgate.client.errors import BadArgument
from armgate.protocol.messages import Entry, SignalValue, State


@dataclass(frozen=True, slots=True)
class Tick:
    """State of the cell at one tick of one robot.

    Attributes:
        robot: Name of the robot.
        state: The complete state message.
    """

    robot: str
    state: State

    def entry(self, robot: str) -> Entry:
        """Return the entry of any robot of the cell; ``entry.time`` is the daemon time of its own tick.

        Raises:
            BadArgument: The state has no such robot.
        """
        for entry in self.state.entries:
            if entry.robot == robot:
                return entry
        known = ", ".join(entry.robot for entry in self.state.entries)
        raise BadArgument(f"no robot {robot} in the state; it holds {known}")

    @property
    def tick(self) -> int:
        """Number of the tick on this robot's clock."""
        return self.state.tick

    @property
    def time(self) -> float:
        """Daemon time of the tick, s."""
        return self.state.time

    @property
    def step(self) -> int | None:
        """Step in lock-step; None by the wall clock."""
        return self.state.step

    @property
    def q(self) -> tuple[float, ...]:
        """Measured position, rad or m by the joint's type."""
        return self._own("q", self.entry(self.robot).q)

    @property
    def setpoint(self) -> tuple[float, ...]:
        """Commanded position, to which the next increment is added, rad or m."""
        return self._own("setpoint", self.entry(self.robot).setpoint)

    @property
    def signals(self) -> Mapping[str, SignalValue]:
        """Newest values of the signals that clients share, by name."""
        return self.state.signals

    def _own(self, field: str, value: tuple[float, ...] | None) -> tuple[float, ...]:
        if value is None:
            raise BadArgument(
                f"{field} of {self.robot} was not subscribed; subscribe with fields=None for all"
            )
        return value
