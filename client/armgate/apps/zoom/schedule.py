"""Wanted view distance of a simulated operator: it changes at a constant rate, then pauses."""

from collections.abc import Sequence

import numpy as np

from armgate.apps.errors import UsageError
from armgate.client import Tick, Verdict
from armgate.client.program import REST, Outcome, ProgramContext

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

    Raises:
        UsageError: The distances are not in order.
    """

    def __init__(self, low: float, high: float, start: float, rate: float, seed: int) -> None:
        if not low <= start <= high:
            raise UsageError(f"expected --low ≤ --start ≤ --high, got {low:g}, {start:g} and {high:g} m")
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


class ZoomProgram:
    """Share the distance until the duration has passed or an end is requested; a `Program` without a robot.

    Args:
        schedule: Wanted distance over time.
        duration: Time after which it ends, s; None: without limit.

    Attributes:
        fields: No fields of the entries are read.
        outcome: The outcome, once it has ended.
    """

    fields: Sequence[str] | None = ()
    outcome = Outcome("duration has passed")

    def __init__(self, schedule: DistanceSchedule, duration: float | None = None) -> None:
        self._schedule = schedule
        self._duration = duration
        self._begin: float | None = None
        self._wanted = self._shared = float("nan")

    def step(self, tick: Tick) -> tuple[float, ...] | None:
        """Update the wanted distance."""
        self._begin = tick.time if self._begin is None else self._begin
        passed = tick.time - self._begin
        if self._duration is not None and passed >= self._duration:
            return None
        self._wanted = self._schedule.at(passed)
        return REST

    def signals(self) -> dict[str, float]:
        """Return the distance if it has changed."""
        changed, self._shared = self._wanted != self._shared, self._wanted
        return {SIGNAL: self._wanted} if changed else {}

    def verdict(self, verdict: Verdict) -> None:
        """Do nothing: there are no commands."""

    def interrupt(self) -> bool:
        """End at once."""
        return False


def make(
    context: ProgramContext,
    *,
    low: float = 0.5,
    high: float = 1.3,
    start: float = 1.0,
    rate: float = 0.1,
    duration: float | None = None,
) -> ZoomProgram:
    """Make the program; the options are those of ``armgate zoom``, and the seed is that of the context.

    Raises:
        UsageError: The distances are not in order.
    """
    return ZoomProgram(DistanceSchedule(low, high, start, rate, context.seed), duration)
