"""Link to a robot that is emulated in the same process."""

from collections.abc import Sequence

from armgate.emulator import EmulatedRobot
from armgate.events import Joints, Plan, PlanAnswer, Rebase, Tick
from armgate.links.plan_player import PlanPlayer


class EmulatedLink:
    """Link that plays plans to an `EmulatedRobot`; a `SteppedLink`.

    At a tick, the robot has followed the setpoint of the previous tick for one period. The link
    first measures its position; then the increment of this tick moves the setpoint.

    Args:
        robot: Name of the robot.
        start: Start id that plans carry.
        q0: Position and setpoint at tick 0, rad or m per joint.
        period: Time between two ticks, s.
        lag: Time constant with which the robot follows, s: one for all joints, or one per joint.
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
        """Name of the robot."""
        return self._name

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""
        return self._player.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap (see `PlanPlayer.offer`)."""
        return self._player.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take ``rebase.setpoint`` as the commanded position."""
        self._player.rebase(rebase.resets)
        self._setpoint = rebase.setpoint

    def advance(self, time: float) -> Tick:
        """Advance the robot by one tick, at daemon time ``time``, s."""
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
