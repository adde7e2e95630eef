"""The way to one robot, whatever stands behind it."""

from collections.abc import Callable
from typing import Protocol

from armgate.events import LinkChange, Plan, PlanAnswer, Rebase, Tick

LinkEvent = Tick | LinkChange
"""What a link tells whoever holds it."""

Emit = Callable[[LinkEvent], None]
"""Takes an event of a link; returns soon."""


class Link(Protocol):
    """Holds the plan of one robot and plays it at the robot's ticks."""

    @property
    def robot(self) -> str:
        """The robot's name."""

    @property
    def remaining(self) -> int:
        """How many increments are still to be played if nothing else comes; 0 at rest."""

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap."""

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take the given setpoint as the commanded position."""


class SteppedLink(Link, Protocol):
    """A link whose robot has no clock of its own: somebody else's clock makes it tick."""

    def advance(self, time: float) -> Tick:
        """Let the robot tick once.

        Args:
            time: Daemon time of the tick, s.

        Returns:
            What was measured and played. The first tick is number 0.
        """


class SelfClockedLink(Link, Protocol):
    """A link whose robot is the clock.

    It tells of ticks from when the robot speaks. After the robot was lost or has faulted (``LinkChange``)
    nothing is played, and plans are answered with ``inactive``, until `rebase` re-arms the link: then it
    takes its reference anew from what the robot says next, and tells that it is ready.
    """

    async def open(self, emit: Emit) -> None:
        """Start to listen; every tick is emitted after the robot has been answered.

        Args:
            emit: Told of each event, in order.

        Raises:
            OSError: The address cannot be listened on.
        """

    def close(self) -> None:
        """End: the robot is not answered any more."""
