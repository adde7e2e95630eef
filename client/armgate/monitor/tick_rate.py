"""Comparison of the ticks of one robot with the time of its states.

Tick k of a clock with the period T has the time t = k·T + o. A tick can be late, and the next ones can follow
in a burst until they are on time again; a lost tick or a pause delays all later ticks. So the offset o can
rise at any time, and falls back to the offset of ticks on time, but never below it. Only a clock that is
faster than T makes the offset fall further. The least offset of a block of ticks is that of ticks on time,
unless one delay spans the whole block. So the least offset of three blocks in a row is used, and the floor is
the largest of these over the newest blocks. A tick whose offset is too far below the floor is too early.
"""

import math
from collections import deque
from dataclasses import dataclass

from armgate.monitor import tolerances as tol

_ROW = 3
"""Number of blocks in a row of which the least offset is used: no delay or burst is as long."""

_KEPT = 16
"""Number of newest blocks for the floor; older ones are forgotten, so that clock drift raises no alarm."""


@dataclass(frozen=True)
class Ahead:
    """Ticks that arrived too early.

    Attributes:
        gain: Time by which they were early, s.
        bound: Allowed time, s.
        ticks: Number of ticks of the newest two blocks.
        elapsed: Time in which they arrived, s.
    """

    gain: float
    bound: float
    ticks: int
    elapsed: float


class TickRate:
    """Comparison of one robot's ticks with time.

    Args:
        period: Period of the robot's clock, s.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._ticks = max(tol.PACE_TICKS, math.ceil(tol.PACE_TIME / period))
        self._bound = tol.PACE * self._ticks * period
        self.begin()

    def begin(self) -> None:
        """Forget all ticks: the robot's clock may have restarted."""
        self._lows: deque[float] = deque(maxlen=_KEPT)
        self._floor = -math.inf
        self._starts: deque[tuple[int, float]] = deque(maxlen=2)
        self._low = math.inf

    def check(self, tick: int, time: float) -> Ahead | None:
        """Check one more tick; return the excess if the tick is too early."""
        offset = time - tick * self._period
        if not self._starts:
            self._starts.append((tick, time))
        elif tick - self._starts[-1][0] >= self._ticks:
            self._end_block()
            self._starts.append((tick, time))
        self._low = min(self._low, offset)
        if not self._floor - offset > self._bound:
            return None
        first, since = self._starts[0]
        ahead = Ahead(self._floor - offset, self._bound, tick - first, time - since)
        self.begin()
        return ahead

    def _end_block(self) -> None:
        self._lows.append(self._low)
        self._low = math.inf
        lows = list(self._lows)
        rows = [min(lows[i : i + _ROW]) for i in range(len(lows) - _ROW + 1)]
        self._floor = max(rows, default=-math.inf)
