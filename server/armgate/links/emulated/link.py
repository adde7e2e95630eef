"""Link to a robot that is emulated in the same process."""

from collections.abc import Sequence

from armgate.emulator import EmulatedRobot
from armgate.events import Joints, Rebase, Tick
from armgate.links.plan_player import PlanPlayer


class EmulatedLink(PlanPlayer):
    """Player of plans for an `EmulatedRobot`; a `SteppedLink`.

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
        super().__init__(robot, start)
        self._robot = EmulatedRobot(q0, period, lag)
        self._setpoint: Joints = self._robot.q
        self._rest: Joints = (0.0,) * len(self._setpoint)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take ``rebase.setpoint`` as the commanded position."""
        super().rebase(rebase)
        self._setpoint = rebase.setpoint

    def advance(self, time: float) -> Tick:
        """Advance the robot by one tick, at daemon time ``time``, s."""
        first = self.tick < 0
        q = self._robot.q if first else self._robot.step(self._setpoint)
        played = self.play()
        increment = self._rest if played.increment is None else played.increment
        self._setpoint = tuple([p + u for p, u in zip(self._setpoint, increment, strict=True)])
        return Tick(
            robot=self.robot,
            tick=self.tick,
            time=time,
            q=q,
            setpoint=self._setpoint,
            increment=increment,
            plan=played.key,
            index=played.index,
        )
