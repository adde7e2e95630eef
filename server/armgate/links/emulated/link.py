"""The link to an emulated robot, in the daemon's own process."""

from collections.abc import Callable, Sequence
from typing import Protocol

from armgate.emulator import EmulatedRobot, WallClock
from armgate.events import Joints, LinkChange, LinkState, Plan, PlanAnswer, Rebase, Tick
from armgate.links.link import Emit
from armgate.links.plan_player import PlanPlayer


class EmulatedLink:
    """Plays plans to an `EmulatedRobot`; a `SteppedLink`.

    At a tick the robot has followed the setpoint of the tick before for one period; that is what it measures.
    Then the increment of this tick moves the setpoint.

    Args:
        robot: The robot's name.
        start: The daemon's start id.
        q0: Position and setpoint at tick 0, rad or m per joint.
        period: Time between two ticks, s.
        lag: Time constant with which the robot follows, s, of all joints or of each.
    """

    def __init__(
        self, robot: str, start: str, q0: Sequence[float], period: float, lag: float | Sequence[float]
    ) -> None:
        self._name = robot
        self._player = PlanPlayer(robot, start)
        self._robot = EmulatedRobot(q0, period, lag)
        self._setpoint: Joints = self._robot.q
        self._rest: Joints = (0.0,) * len(self._setpoint)

    @property
    def robot(self) -> str:
        """The robot's name."""
        return self._name

    @property
    def remaining(self) -> int:
        """How many increments are still to be played if nothing else comes; 0 at rest."""
        return self._player.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap (see `PlanPlayer.offer`)."""
        return self._player.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take ``rebase.setpoint`` as the commanded position."""
        self._player.rebase(rebase.resets)
        self._setpoint = rebase.setpoint

    def advance(self, time: float) -> Tick:
        """Let the robot tick once at daemon time ``time``, s."""
        first = self._player.tick < 0
        q = self._robot.q if first else self._robot.step(self._setpoint)
        played = self._player.play()
        increment = self._rest if played.increment is None else played.increment
        self._setpoint = tuple(s + d for s, d in zip(self._setpoint, increment, strict=True))
        return Tick(
            robot=self._name,
            tick=self._player.tick,
            time=time,
            q=q,
            setpoint=self._setpoint,
            increment=increment,
            plan=played.key,
            index=played.index,
        )


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


class SelfClockedEmulatedLink:
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
