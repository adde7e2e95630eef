"""The way to one robot, whatever stands behind it."""

from typing import Protocol

from armgate.cell.events import Plan, PlanAnswer, Rebase, Tick


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


class ClockedLink(Link, Protocol):
    """A link whose robot has no clock of its own: somebody else's clock makes it tick."""

    def advance(self, time: float) -> Tick:
        """Let the robot tick once.

        Args:
            time: Daemon time of the tick, s.

        Returns:
            What was measured and played. The first tick is number 0.
        """
