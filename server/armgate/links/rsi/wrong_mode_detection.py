"""Detection of a KRC that adds up a correction although the cell has the absolute mode.

The probe has excluded this before any plan was played. This is the second line of defence, in case the KRC's
mode has changed since. Then a repeated correction would move the robot on, and so would missing replies if
HOLDON is 1. A robot that follows a commanded path with a lag stays between the past setpoints, and is never
faster than they were. A robot whose corrections are added up leaves this range in the direction of its
correction, and moves by its whole correction in each cycle, or as fast as the axis can. A robot that is
pushed from outside moves more slowly. It must not be mistaken for this fault: zeros, the reaction to it,
would command an absolute KRC back by the whole correction.
"""

from collections import deque

from armgate.events import Joints

_WINDOW = 0.5
"""Shortest time for which setpoints count as past, s."""
_TELEGRAMS = 4
"""Number of telegrams over which speeds are compared."""
_FASTER, _FASTEST = 1.5, 1.3
"""Lower bound of the speed, as a multiple of the largest commanded speed; upper bound, as a multiple of the
speed at a relative KRC."""
_SLOWEST, _TOP_SHARE = 0.25, 0.5
"""Lower bounds of the speed, as shares of a relative KRC's (a lag hides a part) and of the top speed."""
_OUTSIDE = 2.0
"""Distance from the past setpoints, in tolerances."""


class AccumulationDetector:
    """Comparison of measured positions with setpoints, axis by axis.

    Args:
        tolerance: Largest distance of each resting joint from its setpoint, rad or m.
        speed: Top speed of each joint, per s.
        period: Cycle of the KRC, s.
    """

    def __init__(self, tolerance: Joints, speed: Joints, period: float) -> None:
        self._tolerance = tolerance
        self._room = tuple(_OUTSIDE * one for one in tolerance)
        self._fast = tuple(_TOP_SHARE * one * period for one in speed)
        self._size = max(round(_WINDOW / period), 1)
        self._past: deque[tuple[Joints, Joints, int]] = deque(maxlen=_TELEGRAMS + 1)
        self._cycle = 0
        self._count = self._size
        self._ranges: deque[list[list[float]]] = deque(maxlen=2)

    def take(self, q: Joints, setpoint: Joints, reference: Joints, cycles: int) -> int | None:
        """Take a telegram into account.

        Args:
            q: Measured position, rad or m.
            setpoint: Commanded position, rad or m.
            reference: Position from which corrections count, rad or m.
            cycles: Cycles since the last telegram.

        Returns:
            Number of the axis whose corrections are added up, None if there is none.
        """
        self._cycle += cycles
        self._past.append((q, setpoint, self._cycle))
        before, was, then = self._past[0]
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
            if self._adds(j, x, x - before[j], setpoint[j] - reference[j], self._cycle - then):
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

    def _adds(self, j: int, q: float, moved: float, total: float, cycles: int) -> bool:
        """Return True if an axis is outside all past setpoints, and as fast as if corrections add up."""
        low = min(ranges[0][j] for ranges in self._ranges)
        high = max(ranges[1][j] for ranges in self._ranges)
        fast = max(ranges[2][j] for ranges in self._ranges)
        outside, along = (q - high, moved) if total > 0.0 else (low - q, -moved)
        adding = cycles * abs(total)
        return (
            outside > self._room[j]
            and along > _FASTER * fast + 0.5 * self._tolerance[j]
            and min(_SLOWEST * adding, self._fast[j] * cycles) < along < _FASTEST * adding
        )
