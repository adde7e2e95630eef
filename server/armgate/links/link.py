"""Interface of a link: the connection to one robot, of any kind."""

from collections.abc import Callable
from typing import Protocol

from armgate.events import LinkChange, Plan, PlanAnswer, Rebase, Tick

LinkEvent = Tick | LinkChange
"""Event that a link reports."""

Emit = Callable[[LinkEvent], None]
"""Function that receives an event of a link; it has to return quickly."""


class Link(Protocol):
    """Link that holds the plan of one robot and plays it at the robot's ticks."""

    @property
    def robot(self) -> str:
        """Name of the robot."""

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""

    def offer(self, plan: Plan) -> PlanAnswer | None:
        """Replace the held plan by compare-and-swap; return None if the answer arrives later, as an event.

        Links in this process use `PlanPlayer.offer` of `armgate.links.plan_player`.
        """

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take the given setpoint as the commanded position."""


class LocalLink(Link, Protocol):
    """Link whose plan is held in this process."""

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap."""


class SteppedLink(LocalLink, Protocol):
    """Link whose robot has no clock of its own: another clock steps it."""

    def advance(self, time: float) -> Tick:
        """Advance the robot by one tick.

        Args:
            time: Daemon time of the tick, s.

        Returns:
            The measured position and the played increment. The first tick is number 0.
        """


class SelfClockedLink(LocalLink, Protocol):
    """Link whose robot is the clock.

    It reports a tick whenever the robot sends its position. When the robot is lost (`LinkChange`), the link
    drops the plan; when it becomes faulted, the link may play the held plan to its end. In both states new
    plans are answered with ``inactive`` until `rebase` re-arms the link. The link then chooses its setpoint
    itself, reports it with the robot's next tick, and reports that it is ready.
    """

    async def open(self, emit: Emit) -> None:
        """Connect, or begin to listen; every tick is emitted after the robot has been answered.

        Args:
            emit: Called with each event, in order.

        Raises:
            OSError: It is not possible to listen on the address.
        """

    def close(self) -> None:
        """Disconnect: the robot is not answered any more."""
