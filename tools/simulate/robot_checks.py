"""Checks of what robots really do, tick by tick, independent of the daemon: limits, clearance and plans."""

from collections.abc import Callable

from armgate.cell.cell import Cell
from armgate.events import Tick
from tools.simulate.cells import KEPT, clearance
from tools.simulate.findings import Findings

_ROUNDING = 1e-9
_NEAR = 1e-6


class RobotChecks:
    """Checks of the ticks of all robots.

    Args:
        cell: The cell.
        findings: Receives violations.
        now: Time of the machine, ns.

    Attributes:
        q: Latest position of each robot.
        abandoned: Time since which no daemon has held the robots, ns; None if one does.
    """

    def __init__(self, cell: Cell, findings: Findings, now: Callable[[], int]) -> None:
        self._robots = {robot.name: robot for robot in cell.robots}
        self._findings, self._now = findings, now
        self._longest = {
            robot.name: 2e9 * (float(max(robot.velocity / robot.deceleration)) + 4 * robot.period) + 1e8
            for robot in cell.robots
        }
        self.q: dict[str, tuple[float, ...]] = {}
        self._last: dict[str, Tick] = {}
        self.abandoned: int | None = None
        self.ticks = 0

    def forget(self) -> None:
        """Begin anew: the robots are emulated by a process that has ended."""
        self.q.clear()
        self._last.clear()

    def tick(self, tick: Tick) -> None:
        """Check a tick of a robot's link."""
        self.ticks += 1
        robot, before = self._robots[tick.robot], self._last.get(tick.robot)
        self._last[tick.robot] = tick
        moved, self.q[tick.robot] = tick.q != self.q.get(tick.robot), tick.q
        text = lambda: f"{tick}"  # noqa: E731
        check = self._findings.check
        inside = all(
            low - _ROUNDING <= x <= high + _ROUNDING
            for x, low, high in zip(tick.setpoint, robot.lower, robot.upper, strict=True)
        )
        check(inside, "joint limits", text)
        moves = tick.increment
        slow = all(abs(d) <= v * robot.period + _ROUNDING for d, v in zip(moves, robot.velocity, strict=True))
        check(slow, "speed limits", text)
        if before is not None and before.tick + 1 == tick.tick:
            self._check_change(before, tick)
        at = tick.plan is None or tick.plan.target + tick.index == tick.tick
        check(at, "plans are played at their ticks", text)
        check(tick.plan is not None or not any(moves), "robots move by plans only", text)
        if self.abandoned is not None and any(moves):
            gone = self._now() - self.abandoned
            check(
                gone < self._longest[tick.robot], "robots rest without a daemon", lambda: f"{gone} ns: {tick}"
            )
        if moved:
            least = clearance(self.q)
            check(least >= KEPT - _NEAR, "clearance", lambda: f"{least} m at {self.q}")

    def _check_change(self, before: Tick, tick: Tick) -> None:
        robot = self._robots[tick.robot]
        if before.setpoint == tick.setpoint and not any(tick.increment) and tick.rebased:
            return
        for a, b, up, down in zip(
            before.increment, tick.increment, robot.acceleration, robot.deceleration, strict=True
        ):
            bound = max(up, down) * robot.period**2 + _ROUNDING
            self._findings.check(abs(b - a) <= bound, "acceleration limits", lambda: f"{tick} after {before}")
