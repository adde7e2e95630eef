"""Stepped link with a wall clock of its own, which makes it a `SelfClockedLink` like that of a real robot."""

from collections.abc import Callable
from typing import Protocol

from armgate.emulator import WallClock
from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, Rebase
from armgate.links.link import Emit, SteppedLink


class Clock(Protocol):
    """Clock of one robot."""

    def start(self) -> None:
        """Start; the first tick is now."""

    def close(self) -> None:
        """Stop: no further tick comes."""


MakeClock = Callable[[float, Callable[[], None]], Clock]
"""Function that makes the clock of a robot: its period, s, and the function to call at each tick."""


def wall_clock(period: float, tick: Callable[[], None]) -> Clock:
    """Return a wall clock."""
    return WallClock([period], lambda _: tick())


class OwnClockLink:
    """Link of a robot that is stepped by a clock of its own; it is never lost.

    Args:
        link: The stepped link.
        period: Period of its clock, s.
        now: Clock that stamps its ticks, s.
        clock: Function that makes its clock.
    """

    def __init__(
        self, link: SteppedLink, period: float, now: Callable[[], float], clock: MakeClock = wall_clock
    ) -> None:
        self._link = link
        self._now = now
        self._clock = clock(period, self._tick)
        self._emit: Emit

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._link.robot

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""
        return self._link.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap."""
        return self._link.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take ``rebase.setpoint`` as the commanded position."""
        self._link.rebase(rebase)

    async def open(self, emit: Emit) -> None:
        """Report that the robot is ready, and start its clock."""
        self._emit = emit
        emit(LinkChange(self.robot, LinkState.READY))
        self._clock.start()

    def close(self) -> None:
        """Stop its clock."""
        self._clock.close()

    def _tick(self) -> None:
        self._emit(self._link.advance(self._now()))
