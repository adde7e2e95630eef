"""Wanted view distance of a simulated operator: it changes at a constant rate, then pauses."""

import numpy as np

from armgate.apps.interrupt import Interrupt
from armgate.client import Cell

SIGNAL = "operator.distance"
HOLD = (1.0, 3.0)
"""Time for which a distance is kept, s: minimum and maximum."""


class DistanceSchedule:
    """Wanted distance over time.

    Args:
        low: Smallest distance, m.
        high: Largest distance, m.
        start: Distance at time 0, m.
        rate: Rate of change, m/s.
        seed: Seed of the random numbers.
    """

    def __init__(self, low: float, high: float, start: float, rate: float, seed: int) -> None:
        self._low, self._high, self._rate = low, high, rate
        self._chance = np.random.default_rng(seed)
        self._from, self._to = start, start
        self._begin, self._end = 0.0, 1.0

    def at(self, time: float) -> float:
        """Return the distance, m, at a time, s, which must not be earlier than in the call before."""
        while time >= self._end:
            self._next()
        way = self._rate * (time - self._begin)
        return self._from + float(np.clip(self._to - self._from, -way, way))

    def _next(self) -> None:
        self._from, self._begin = self._to, self._end
        self._to = float(self._chance.uniform(self._low, self._high))
        hold = float(self._chance.uniform(*HOLD))
        self._end = self._begin + abs(self._to - self._from) / self._rate + hold


def share(cell: Cell, schedule: DistanceSchedule, interrupt: Interrupt, duration: float | None) -> None:
    """Share the distance at each tick of the cell, until the duration has passed or an interruption.

    Raises:
        ConnectionLost: The connection to the daemon was lost.
    """
    begin: float | None = None
    shared: float | None = None
    cell.subscribe(every=1, fields=[])
    for state in cell.states():
        begin = state.time if begin is None else begin
        if interrupt.requested or (duration is not None and state.time - begin >= duration):
            return
        wanted = schedule.at(state.time - begin)
        if wanted != shared:
            cell.signal(SIGNAL, wanted, more=True)
            shared = wanted
        cell.skip()
