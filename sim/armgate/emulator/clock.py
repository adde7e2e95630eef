"""The clocks that make emulated robots tick: virtual time, and the wall clock beside it.

Both run through the same instants. A robot of period T ticks at 0, T, 2T, …; an instant is a time at which at
least one robot ticks. Times are whole nanoseconds, so that mixed periods meet exactly and nothing drifts.
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
    """A time at which robots tick.

    Attributes:
        number: Count of the instants so far, from 0.
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
    """Runs through the instants of some periods as fast as it is asked to.

    Args:
        periods: The robots' periods, s; each is rounded to whole nanoseconds once.

    Raises:
        ValueError: If there is no period, or one is shorter than a nanosecond.
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
        """Go to the next instant."""
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
    """How late wake-ups came: figures for logs and warnings, nothing acts on them.

    Attributes:
        count: Wake-ups so far.
        last: Lateness of the last one, s.
        worst: The largest one, s.
        half: How many came later than half the time to the next instant.
        overruns: How many came after the next instant was already due.
    """

    count: int = 0
    last: float = 0.0
    worst: float = 0.0
    half: int = 0
    overruns: int = 0

    def note(self, late_ns: int, gap_ns: int) -> None:
        """Count a wake-up that came ``late_ns`` after its instant, ``gap_ns`` before the next one."""
        self.count += 1
        self.last = late_ns / NS
        self.worst = max(self.worst, self.last)
        self.half += 2 * late_ns > gap_ns
        self.overruns += late_ns >= gap_ns


class WallClock:
    """Runs through the instants by the monotonic clock, on the running event loop.

    Each instant has an absolute deadline, so lateness never accumulates. A robot ticks once per period
    whatever happens: after a stall the missed instants follow one by one, each at the next turn of the event
    loop, so that sockets are served in between.

    Args:
        periods: The robots' periods, s.
        tick: Called with each instant as it comes.
        now: The monotonic clock, ns; the timer's clock must be the same one.
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
        """Begin: the first instant, at which all robots tick, is now."""
        self._origin = self._now()
        self._timer = Timer()
        asyncio.get_running_loop().add_reader(self._timer.fileno(), self._wake)
        self._arm()

    def close(self) -> None:
        """End: no further instant comes."""
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
