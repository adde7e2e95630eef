"""An emulated robot that is the clock itself, as a real one is: a `DrivenLink`."""

from collections.abc import Callable
from typing import Protocol

from armgate.emulator import WallClock
from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, Rebase
from armgate.links.emulated import EmulatedLink
from armgate.links.link import Emit


class Clock(Protocol):
    """Makes one robot tick."""

    def start(self) -> None:
        """Begin: the first tick is now."""

    def close(self) -> None:
        """End: no further tick comes."""


MakeClock = Callable[[float, Callable[[], None]], Clock]
"""Makes the clock of a robot of this period, s, that calls the function at each tick."""


def wall_clock(period: float, tick: Callable[[], None]) -> Clock:
    """The clock on the wall."""
    return WallClock([period], lambda _: tick())


class DrivenEmulatedLink:
    """An emulated robot with a clock of its own; it is never lost.

    Args:
        link: The robot and its plan.
        period: Of its clock, s.
        now: The time that its ticks carry, s.
        clock: Makes its clock.
    """

    def __init__(
        self, link: EmulatedLink, period: float, now: Callable[[], float], clock: MakeClock = wall_clock
    ) -> None:
        self._link = link
        self._now = now
        self._clock = clock(period, self._tick)
        self._emit: Emit

    @property
    def robot(self) -> str:
        """The robot's name."""
        return self._link.robot

    @property
    def remaining(self) -> int:
        """How many increments are still to be played if nothing else comes; 0 at rest."""
        return self._link.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap."""
        return self._link.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take ``rebase.setpoint`` as the commanded position."""
        self._link.rebase(rebase)

    async def open(self, emit: Emit) -> None:
        """Say that the robot is ready, and let its clock begin."""
        self._emit = emit
        emit(LinkChange(self.robot, LinkState.READY))
        self._clock.start()

    def close(self) -> None:
        """Let its clock end."""
        self._clock.close()

    def _tick(self) -> None:
        self._emit(self._link.advance(self._now()))
