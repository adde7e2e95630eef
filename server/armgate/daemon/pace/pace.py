"""Pace: the passing of time in a cell.

There are three paces: the wall clock, lock-step, and robots that are their own clock. A pace reports ticks to
the receiver that `Pace.start` takes.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from armgate.events import LinkChange, PlanAnswer, Tick
from armgate.world.core import Core


class TickReceiver(Protocol):
    """Part of the daemon that receives the robots' ticks."""

    def due(self, time: float, robots: Sequence[int], step: int | None) -> None:
        """Make robots of this process tick.

        Args:
            time: Daemon time of the instant, s.
            robots: Indices of the robots that are due, ascending.
            step: Number of the instant in lock-step, else None.
        """

    def received(self, event: Tick | LinkChange | PlanAnswer) -> None:
        """Process an event of a robot that is its own clock."""

    def idle(self, time: float) -> None:
        """Do periodic work even if no robot ticks; called repeatedly with daemon time, s."""


class Pace(Protocol):
    """Passing of time in a cell."""

    @property
    def lockstep(self) -> bool:
        """True if time passes in lock-step."""

    @property
    def failed(self) -> bool:
        """True if the run has failed although the daemon works: a participant was dropped."""

    def now(self) -> float:
        """Return daemon time, s."""

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session from the name of its client and the number of its connection."""

    async def open(self) -> None:
        """Connect to the robots; no event is reported before `start`.

        Raises:
            SocketError: There is no robot server, or it refuses the daemon.
        """

    def start(self, core: Core, receiver: TickReceiver) -> None:
        """Make time pass from now on, and report ticks to the receiver."""

    def let_rest(self, decide: bool) -> None:
        """Continue without waiting for any client, until `close`.

        Args:
            decide: True if commands that wait are still passed to the gate.
        """

    def close(self) -> None:
        """End the pace: no further event is reported."""

    def warnings(self) -> Mapping[str, str]:
        """Return warnings for the states, by subject."""

    def figures(self) -> Mapping[str, float]:
        """Return figures for the log at the end of the run."""
