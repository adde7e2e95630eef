"""Clocks that make emulated robots tick: virtual time and wall clock.

Both produce the same instants. A robot of period T ticks at 0, T, 2T, …; an instant is a time at which at
least one robot ticks. Times are whole nanoseconds, so that different periods coincide exactly and do not
drift.
"""

import asyncio
import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic_ns

from armgate.emulator.timer import Timer

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Instant:
    """Time at which robots tick.

    Attributes:
        number: Number of the instant, counted from 0.
        ns: Time since the clock's start, ns.
        due: Indices of the robots that tick, ascending.
    """

    number: int
    ns: int
    due: tuple[int, ...]

    @property
    def time(self) -> float:
        """Time since the clock's start, s."""
        return self.ns / NS


class VirtualClock:
    """Clock whose instants follow as fast as ``advance`` is called.

    Args:
        periods: Periods of the robots, s; each is rounded to whole nanoseconds once.

    Raises:
        ValueError: There is no period, or a period is shorter than a nanosecond.
    """

    def __init__(self, periods: Sequence[float]) -> None:
        self._periods = [round(period * NS) for period in periods]
        if not self._periods or min(self._periods) < 1:
            raise ValueError(f"periods {list(periods)}: expected at least one, each above 0 s")
        self._due = [(0, index) for index in range(len(self._periods))]
        self._number = 0

    @property
    def next_ns(self) -> int:
        """Time of the next instant, ns since the start."""
        return self._due[0][0]

    def advance(self) -> Instant:
        """Advance to the next instant and return it."""
        now = self.next_ns
        due = []
        while self.next_ns == now:
            index = self._due[0][1]
            due.append(index)
            heapq.heapreplace(self._due, (now + self._periods[index], index))
        instant = Instant(self._number, now, tuple(due))
        self._number += 1
        return instant


@dataclass(slots=True)
class Lateness:
    """Lateness of wake-ups, for logs and warnings only.

    Attributes:
        count: Number of wake-ups.
        last: Lateness of the last wake-up, s.
        worst: Largest lateness, s.
        half: Number of wake-ups that were later than half the time to the next instant.
        overruns: Number of wake-ups after the next instant was already due.
    """

    count: int = 0
    last: float = 0.0
    worst: float = 0.0
    half: int = 0
    overruns: int = 0

    def note(self, late_ns: int, gap_ns: int) -> None:
        """Count a wake-up ``late_ns`` after its instant; the next instant follows after ``gap_ns``."""
        self.count += 1
        self.last = late_ns / NS
        self.worst = max(self.worst, self.last)
        self.half += 2 * late_ns > gap_ns
        self.overruns += late_ns >= gap_ns


class WallClock:
    """Clock whose instants follow the monotonic clock, on the running event loop.

    Each instant has an absolute deadline, so lateness never accumulates. A robot ticks exactly once per
    period: after a stall the missed instants follow one by one, each in the next iteration of the event loop,
    so that sockets are served in between.

    Args:
        periods: Periods of the robots, s.
        tick: Called with each instant.
        now: Monotonic clock, ns; the timer must use the same clock.
    """

    def __init__(
        self, periods: Sequence[float], tick: Callable[[Instant], None], now: Callable[[], int] = monotonic_ns
    ) -> None:
        self._instants = VirtualClock(periods)
        self._tick = tick
        self._now = now
        self._origin = now()
        self._timer: Timer | None = None
        self.lateness = Lateness()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return (self._now() - self._origin) / NS

    def start(self) -> None:
        """Start the clock; the first instant, at which all robots tick, is now."""
        self._origin = self._now()
        self._timer = Timer()
        asyncio.get_running_loop().add_reader(self._timer.fileno(), self._wake)
        self._arm()

    def close(self) -> None:
        """Stop the clock: no further instant follows."""
        if self._timer is not None:
            asyncio.get_running_loop().remove_reader(self._timer.fileno())
            self._timer.close()
            self._timer = None

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.arm(self._origin + self._instants.next_ns)

    def _wake(self) -> None:
        if self._timer is None or not self._timer.expired():
            return
        instant = self._instants.advance()
        late = self._now() - self._origin - instant.ns
        self.lateness.note(late, self._instants.next_ns - instant.ns)
        self._arm()
        self._tick(instant)
