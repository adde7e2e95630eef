"""Detection of a robot that adds up a correction which is meant as its whole offset.

The probe has excluded it before anything moved. This is the second line, in case the KRC's mode has changed
since: repeating the held total would then move the robot on, and silence too if HOLDON is 1. A robot that
follows a commanded path with a lag stays between the setpoints of the past, and is no faster than they were.
One that adds up leaves them in the direction of its correction, and is faster.
"""

from collections import deque
from collections.abc import Sequence

from armgate.cell.events import Joints

_WINDOW = 0.5
"""Setpoints of this time at least are those of the past, s."""
_CYCLES = 4
"""Telegrams over which speeds are compared."""
_FASTER, _FASTEST = 1.5, 1.3
"""Speed in commanded speeds from which on, and in speeds of a relative KRC up to which, a robot adds up."""
_OUTSIDE = 2.0
"""Distance from the setpoints of the past, in tolerances."""


class Runaway:
    """Compares measured positions with setpoints, axis by axis.

    Args:
        tolerance: How far a resting joint may be from where it should be, rad or m.
        period: s.
    """

    def __init__(self, tolerance: Joints, period: float) -> None:
        self._tolerance = tolerance
        self._size = max(round(_WINDOW / period), 1)
        self._past: deque[tuple[Joints, Joints]] = deque(maxlen=_CYCLES + 1)
        self._low: list[float] = []
        self._high: list[float] = []
        self._fast: list[float] = []
        self._older: tuple[Sequence[float], Sequence[float], Sequence[float]] | None = None
        self._count = 0

    def take(self, q: Joints, setpoint: Joints, reference: Joints) -> int | None:
        """Take a telegram over; return the axis that adds up, None if none does."""
        self._past.append((q, setpoint))
        if not self._low or self._count >= self._size:
            self._older = (self._low, self._high, self._fast) if self._low else None
            self._low, self._high, self._fast = list(setpoint), list(setpoint), [0.0] * len(q)
            self._count = 0
        self._count += 1
        if setpoint == reference or len(self._past) <= _CYCLES:
            return None
        before, was = self._past[0]
        for j, now in enumerate(setpoint):
            self._low[j], self._high[j] = min(self._low[j], now), max(self._high[j], now)
            self._fast[j] = max(self._fast[j], abs(now - was[j]))
            if self._adds(j, q[j], q[j] - before[j], now - reference[j]):
                return j
        return None

    def _adds(self, j: int, q: float, moved: float, total: float) -> bool:
        low, high, fast = self._low[j], self._high[j], self._fast[j]
        if self._older is not None:
            low, high = min(low, self._older[0][j]), max(high, self._older[1][j])
            fast = max(fast, self._older[2][j])
        tolerance = self._tolerance[j]
        outside = q - high if total > 0.0 else low - q
        along = moved if total > 0.0 else -moved
        return (
            outside > _OUTSIDE * tolerance
            and along > _FASTER * fast + 0.5 * tolerance
            and along < _FASTEST * _CYCLES * abs(total)
        )
