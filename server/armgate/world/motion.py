"""Motion of robots: last tick of each robot, and detection that all robots are at rest."""

from collections.abc import Mapping, Sequence
from operator import sub

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
        self._moved: dict[str, float] = {}

    @property
    def ticks(self) -> Mapping[str, Tick]:
        """Last tick of each robot that has ticked."""
        return self._ticks

    def note(self, tick: Tick) -> None:
        """Process a tick."""
        before = self._ticks.get(tick.robot, tick)
        # The increment just played is measured only at the next tick. Until then it counts as motion.
        moved = map(sub, tick.q, before.q)
        self._moved[tick.robot] = max(map(abs, (*moved, *tick.increment)))
        self._ticks[tick.robot] = tick

    @property
    def at_rest(self) -> bool:
        """True if no link has increments left to play and no robot moved at its last tick."""
        return not any(link.remaining for link in self._links) and all(
            moved <= self._noise[robot] for robot, moved in self._moved.items()
        )

    @property
    def time_left(self) -> float:
        """Time until the last robot has played its plan, s."""
        return max(link.remaining * self._periods[link.robot] for link in self._links)
