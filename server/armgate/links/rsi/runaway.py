"""Detection of a robot that adds up a correction which is meant as its whole offset.

The probe has excluded it before anything moved. This is the second line, in case the KRC's mode has changed
since: repeating the held total would then move the robot on, and silence too if HOLDON is 1. A robot that
follows a commanded path with a lag stays between the setpoints of the past, and is no faster than they were.
One that adds up leaves them in the direction of its correction, and is faster.
"""

from collections import deque

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
        self._room = tuple(_OUTSIDE * one for one in tolerance)
        self._size = max(round(_WINDOW / period), 1)
        self._past: deque[tuple[Joints, Joints]] = deque(maxlen=_CYCLES + 1)
        self._count = self._size
        self._ranges: deque[list[list[float]]] = deque(maxlen=2)

    def take(self, q: Joints, setpoint: Joints, reference: Joints) -> int | None:
        """Take a telegram over; return the axis that adds up, None if none does."""
        self._past.append((q, setpoint))
        before, was = self._past[0]
        if self._count >= self._size:
            self._count = 0
            self._ranges.append([list(setpoint), list(setpoint), [0.0] * len(q)])
        self._count += 1
        if was is not setpoint:
            self._widen(setpoint, was)
        low, high, _ = self._ranges[-1]
        for j, (x, room) in enumerate(zip(q, self._room, strict=True)):
            if low[j] - room <= x <= high[j] + room:
                continue
            if self._adds(j, x, x - before[j], setpoint[j] - reference[j]):
                return j
        return None

    def _widen(self, setpoint: Joints, was: Joints) -> None:
        low, high, fast = self._ranges[-1]
        for j, (now, then) in enumerate(zip(setpoint, was, strict=True)):
            if now < low[j]:
                low[j] = now
            elif now > high[j]:
                high[j] = now
            fast[j] = max(fast[j], abs(now - then))

    def _adds(self, j: int, q: float, moved: float, total: float) -> bool:
        """Return True if an axis is outside of older setpoints too, and as fast as if it added up."""
        low = min(ranges[0][j] for ranges in self._ranges)
        high = max(ranges[1][j] for ranges in self._ranges)
        fast = max(ranges[2][j] for ranges in self._ranges)
        outside, along = (q - high, moved) if total > 0.0 else (low - q, -moved)
        return (
            outside > self._room[j]
            and along > _FASTER * fast + 0.5 * self._tolerance[j]
            and along < _FASTEST * _CYCLES * abs(total)
        )
