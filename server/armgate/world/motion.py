"""Motion of robots: last tick of each robot, and detection that all robots are at rest."""

from collections.abc import Mapping, Sequence

from armgate.cell.cell import Cell
from armgate.events import Tick
from armgate.links.link import Link


class Motion:
    """Motion of all robots, from their ticks and the plans that their links hold.

    Args:
        cell: The cell.
        links: Link of each robot, in the order of the configuration.
    """

    def __init__(self, cell: Cell, links: Sequence[Link]) -> None:
        self._links = tuple(links)
        self._periods = {robot.name: robot.period for robot in cell.robots}
        # Two measurements of a robot at rest differ by up to twice the tolerance.
        self._noise = {robot.name: 2.0 * robot.q_tolerance for robot in cell.robots}
        self._ticks: dict[str, Tick] = {}
        self._before: dict[str, Tick] = {}

    @property
    def ticks(self) -> Mapping[str, Tick]:
        """Last tick of each robot that has ticked."""
        return self._ticks

    def note(self, tick: Tick) -> None:
        """Process a tick."""
        self._before[tick.robot] = self._ticks.get(tick.robot, tick)
        self._ticks[tick.robot] = tick

    @property
    def at_rest(self) -> bool:
        """True if no link has increments left to play and no robot moved at its last tick."""
        return not any(link.remaining for link in self._links) and all(
            self._moved(robot) <= self._noise[robot] for robot in self._ticks
        )

    def _moved(self, robot: str) -> float:
        """Return the largest motion of a joint at the last tick, rad or m."""
        before, tick = self._before[robot], self._ticks[robot]
        # The increment just played is measured only at the next tick. Until then it counts as motion.
        moved = [q - earlier for q, earlier in zip(tick.q, before.q, strict=False)]
        return max(map(abs, (*moved, *tick.increment)))

    @property
    def time_left(self) -> float:
        """Time until the last robot has played its plan, s."""
        return max(link.remaining * self._periods[link.robot] for link in self._links)
