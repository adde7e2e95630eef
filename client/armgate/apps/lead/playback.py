"""Playback of a recorded path: one increment per tick, in a path time that waits for a lagging robot."""

import math
from operator import le

import numpy as np
from numpy.typing import NDArray

from armgate.apps.lead.path import RecordedPath
from armgate.apps.lead.shaping import Bounds

Array = NDArray[np.float64]

RAMP = 0.5
"""Time in which the pace of the path rises from 0 to 1, s."""
BEHIND = 2.0
"""Largest lag of the setpoint behind the path, in ticks at full speed; beyond it the path waits."""
SLOW = 0.2
"""Share of the largest speed used for the approach to the start of the path."""
REACHED = 1e-6
"""Distance below which a joint has arrived, rad or m."""


class Playback:
    """Playback in path time τ, which advances at 0 to 1 times the rate of real time.

    The pace rises while the setpoint keeps up, and falls to 0 while it does not because the gate refuses or
    limits commands. So the path never gets ahead of the robot by more than the allowed lag, and continues
    where it stopped. Before the path starts, the robot moves to its first position, slowly and on a straight
    line in joint space.

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
        self._lag: list[float] = (BEHIND * bounds.increment).tolist()
        # Position at path time `time`, once the path has started.
        self._here = path.at(0.0)

    @property
    def period(self) -> float:
        """Period of the robot's ticks, s."""
        return self._bounds.period

    @property
    def progress(self) -> float:
        """Share of this run's path that was played, 0 to 1."""
        return self.time / self.end if self.end > 0.0 else 1.0

    @property
    def approaching(self) -> bool:
        """True while the robot approaches the start of the path."""
        return not self._started

    @property
    def waiting(self) -> bool:
        """True if playback is paused because the robot lags behind."""
        return self._started and self._pace == 0.0 and 0.0 < self.time < self.end

    def step(self, setpoint: Array, last: Array) -> Array:
        """Return the wanted increment of the next tick.

        Args:
            setpoint: Current setpoint (n,).
            last: Admitted increment that led to it (n,).
        """
        if not self._started:
            self._started = self._at(self._here, setpoint, last)
            wanted = self._bounds.approach(self._here - setpoint, SLOW)
            return self._bounds.limit(wanted, last)
        here = self._here
        behind = here - setpoint
        self._advance(behind)
        self._here = self._path.at(self.time)
        return self._bounds.limit(self._here - here + self._bounds.approach(behind), last)

    def brake(self, last: Array) -> Array:
        """Return the increment that brings the robot to rest instead."""
        return self._bounds.braking(last)

    def finished(self, setpoint: Array, last: Array) -> bool:
        """Return True if the run has ended: last position reached, at rest."""
        return self._started and self.time >= self.end and self._at(self._path.at(self.end), setpoint, last)

    def _advance(self, behind: Array) -> None:
        """Advance path time by one tick at the new pace, braking in time for the end."""
        T = self._bounds.period
        change = T / RAMP
        keeps_up = all(map(le, map(abs, behind.tolist()), self._lag))
        wanted = self._pace + change if keeps_up else self._pace - 4.0 * change
        # v² = 2 s / RAMP: the pace from which the path comes to rest within the rest of this run.
        left = self.end - self.time
        stop = math.sqrt(2.0 * left / RAMP) if self.end < self._path.duration else 1.0
        self._pace = min(max(wanted, 0.0), 1.0, stop)
        self.time = min(self.time + self._pace * T, self.end)
        if left < REACHED:
            self.time = self.end

    @staticmethod
    def _at(place: Array, setpoint: Array, last: Array) -> bool:
        return bool(np.all(np.abs(place - setpoint) < REACHED) and np.all(np.abs(last) < REACHED))
