"""Clear positions of the agent's robots, found by moving there through the gate.

Each position is the end of a motion from the configured start towards a random position. The gate decides
about every increment of the motion, so the position is clear, within all limits, and reachable.
"""

import pickle
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from armgate.env.actions import Actions
from armgate.env.episode import Cast, Episode
from armgate.env.errors import EnvError
from armgate.world import RunRecorder

Array = NDArray[np.float64]

_LONGEST = 400
"""Largest number of steps of a motion."""
_SETTLE = 200
"""Largest number of steps in which a robot comes to rest."""
_AT_REST = 1e-6
"""Increment, and difference of position and setpoint, below which a robot is at rest, rad or m."""


class Places:
    """Pool of episodes that begin at clear positions. They are made when they are first needed.

    Place 0 is the configured start. The other places depend only on the cell, their number and the spread.

    Args:
        cast: Division of the cell's robots.
        count: Number of places, at least 1.
        spread: Largest distance from the start, as a share of each joint's range.
        compiled: Form of the gate's kernels, as for `World`.
    """

    def __init__(self, cast: Cast, count: int, spread: float, compiled: bool | None) -> None:
        self._cast = cast
        self.count = count
        self._spread = spread
        self._compiled = compiled
        self._actions = Actions([cast.cell.robot(name) for name in cast.agent], "joint", within=True)
        self._saved: dict[int, bytes] = {}
        self._positions: dict[int, dict[str, Array]] = {}

    def checked(self, place: object) -> int:
        """Return the number of a place.

        Raises:
            EnvError: There is no such place.
        """
        if not isinstance(place, int | np.integer) or isinstance(place, bool) or not 0 <= place < self.count:
            raise EnvError(f"reset option 'place': {place!r}; expected 0 to {self.count - 1}")
        return int(place)

    def episode(self, place: int) -> Episode:
        """Return a new episode that begins at a place."""
        if place not in self._saved:
            self._save(place, self._made(place, ()))
        episode = pickle.loads(self._saved[place])  # noqa: S301 (saved by this object)
        assert isinstance(episode, Episode)
        episode.resume(self._cast.cell)
        return episode

    def recorded(self, place: int, recorders: Sequence[RunRecorder]) -> Episode:
        """Return the same episode with recorders, which also record the motion to the place."""
        return self._made(place, recorders)

    def position(self, place: int) -> Mapping[str, Array]:
        """Return the position of the agent's robots at a place: (n,) by robot, rad or m."""
        if place not in self._positions:
            self._save(place, self._made(place, ()))
        return self._positions[place]

    def _save(self, place: int, episode: Episode) -> None:
        self._saved[place] = pickle.dumps(episode)
        arms = episode.arms
        self._positions[place] = {robot: arms[robot].q for robot in self._cast.agent}

    def _made(self, place: int, recorders: Sequence[RunRecorder]) -> Episode:
        episode = Episode(self._cast, recorders, self._compiled)
        if place > 0:
            self._move(episode, self._target(place))
        return episode

    def _target(self, place: int) -> dict[str, Array]:
        """Return the random position towards which the robots move."""
        random = np.random.default_rng(place)
        targets = {}
        for name in self._cast.agent:
            robot = self._cast.cell.robot(name)
            way = self._spread * (robot.upper - robot.lower) * random.uniform(-1.0, 1.0, len(robot.lower))
            targets[name] = np.clip(robot.start + way, robot.lower, robot.upper)
        return targets

    def _move(self, episode: Episode, targets: Mapping[str, Array]) -> None:
        """Move until the targets are reached, or the gate refuses, then to rest."""
        for _ in range(_LONGEST):
            arms = episode.arms
            wanted = {
                name: self._toward(name, target, arms[name].setpoint) for name, target in targets.items()
            }
            if all(np.abs(dq).max() < _AT_REST for dq in wanted.values()):
                break
            verdicts = episode.step(self._actions, wanted)
            if any(verdict.outcome == "refused" for verdict in verdicts):
                break
        self._rest(episode)

    def _rest(self, episode: Episode) -> None:
        still = {name: np.zeros(len(self._cast.cell.robot(name).lower)) for name in self._cast.agent}
        for _ in range(_SETTLE):
            arms = [episode.arms[name] for name in self._cast.agent]
            moving = max(max(np.abs(a.increment).max(), np.abs(a.q - a.setpoint).max()) for a in arms)
            if moving < _AT_REST:
                return
            episode.step(self._actions, still)

    def _toward(self, robot: str, target: Array, setpoint: Array) -> Array:
        """Return the increment on the straight line to the target, which brakes in time."""
        bounds, left = self._actions.bounds[robot], target - setpoint
        pace = np.minimum(bounds.step / 3.0, np.sqrt(bounds.change * np.abs(left)))
        share = float(np.min(pace / np.maximum(np.abs(left), 1e-12)))
        return left * min(1.0, share)
