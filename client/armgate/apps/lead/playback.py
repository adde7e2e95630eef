"""Plays a recorded path: one increment a tick, and a path time that waits whenever the robot falls behind."""

import math

import numpy as np
from numpy.typing import NDArray

from armgate.apps.lead.path import RecordedPath
from armgate.apps.lead.shaping import Bounds

Array = NDArray[np.float64]

RAMP = 0.5
"""Time in which the path's pace goes from rest to full, s."""
BEHIND = 2.0
"""How many ticks at full speed the setpoint may be behind its path before the path waits."""
SLOW = 0.2
"""Share of the largest speed with which the start of the path is approached."""
REACHED = 1e-6
"""Distance at which a joint counts as having arrived, rad or m."""


class Playback:
    """Follows a path in its own time τ, which runs with a pace between 0 and 1 of the clock's.

    The pace grows while the setpoint keeps up and falls to nothing while it does not (the gate refuses or
    limits): so the path never runs away from the robot, and goes on where it was. Before the path starts, the
    robot is driven to its first position, slowly and straight.

    Attributes:
        time: Path time τ reached, s.
        end: Path time at which this run ends, at rest, s.
    """

    def __init__(self, path: RecordedPath, bounds: Bounds, duration: float | None = None) -> None:
        self.time = 0.0
        self.end = path.duration if duration is None else min(duration, path.duration)
        self._path = path
        self._bounds = bounds
        self._pace = 0.0
        self._started = False

    @property
    def period(self) -> float:
        """The robot's tick, s."""
        return self._bounds.period

    @property
    def progress(self) -> float:
        """Share of this run's path that is done, 0 to 1."""
        return self.time / self.end if self.end > 0.0 else 1.0

    @property
    def approaching(self) -> bool:
        """Whether the robot is still on its way to the path's start."""
        return not self._started

    @property
    def waiting(self) -> bool:
        """Whether the path stands still because the robot does not keep up."""
        return self._started and self._pace == 0.0 and 0.0 < self.time < self.end

    def step(self, setpoint: Array, last: Array) -> Array:
        """The wish for the next tick.

        Args:
            setpoint: Commanded position now (n,).
            last: The increment that led to it, as it was admitted (n,).
        """
        if not self._started:
            self._started = self._at(self._path.at(0.0), setpoint, last)
            wish = self._bounds.approach(self._path.at(0.0) - setpoint, SLOW)
            return self._bounds.limit(wish, last)
        here = self._path.at(self.time)
        behind = here - setpoint
        self._advance(behind)
        ahead = self._path.at(self.time) - here
        return self._bounds.limit(ahead + self._bounds.approach(behind), last)

    def brake(self, last: Array) -> Array:
        """The wish that slows the robot to rest instead."""
        return self._bounds.braking(last)

    def finished(self, setpoint: Array, last: Array) -> bool:
        """Whether the run has ended: its last position reached, at rest."""
        return self._started and self.time >= self.end and self._at(self._path.at(self.end), setpoint, last)

    def _advance(self, behind: Array) -> None:
        """Moves path time on by one tick at the new pace, braking in time for the end."""
        T = self._bounds.period
        change = T / RAMP
        keeps_up = bool(np.all(np.abs(behind) <= BEHIND * self._bounds.increment))
        wanted = self._pace + change if keeps_up else self._pace - 4.0 * change
        # v² = 2 s / RAMP: the pace from which the path comes to rest within what is left of this run.
        left = self.end - self.time
        stop = math.sqrt(2.0 * left / RAMP) if self.end < self._path.duration else 1.0
        self._pace = min(max(wanted, 0.0), 1.0, stop)
        self.time = min(self.time + self._pace * T, self.end)
        if left < REACHED:
            self.time = self.end

    @staticmethod
    def _at(place: Array, setpoint: Array, last: Array) -> bool:
        return bool(np.all(np.abs(place - setpoint) < REACHED) and np.all(np.abs(last) < REACHED))
