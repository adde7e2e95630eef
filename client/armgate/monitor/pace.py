"""Ticks of one robot against the time of its states.

A tick k of a clock of period T has the time t = k·T + o. A tick can be late, and those after it can follow in
a burst until they are on time again; a tick that was lost or a pause delays all that follow. So the offset o
rises at any time, and falls back to that of the ticks on time, but never below it: a clock that is faster
than T makes it fall on and on. The least offset of a block of ticks is that of ticks on time, unless a delay
spanned the whole block; so the floor is the least of three blocks in a row.
"""

import math
from collections import deque
from dataclasses import dataclass

from armgate.monitor import tolerances as tol

_ROW = 3
"""Blocks in a row whose least offset is the floor: no burst is as long."""

_KEPT = 16
"""Blocks that count: a tick that was lost delays all after it, so the floor must rise again."""


@dataclass(frozen=True)
class Ahead:
    """Ticks ahead of their time.

    Attributes:
        gain: By how much, s.
        bound: How much is allowed, s.
        ticks: Ticks of the newest two blocks.
        elapsed: Their time, s.
    """

    gain: float
    bound: float
    ticks: int
    elapsed: float


class Pace:
    """Compares ticks with time.

    Args:
        period: Of the robot's clock, s.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._ticks = max(tol.PACE_TICKS, math.ceil(tol.PACE_TIME / period))
        self._bound = tol.PACE * self._ticks * period
        self.begin()

    def begin(self) -> None:
        """Forget all ticks: the robot's clock may have been another."""
        self._lows: deque[float] = deque(maxlen=_KEPT)
        self._floor = -math.inf
        self._starts: deque[tuple[int, float]] = deque(maxlen=2)
        self._low = math.inf

    def take(self, tick: int, time: float) -> Ahead | None:
        """Take one more tick; return by how much it is ahead of its time, if that is too much."""
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
