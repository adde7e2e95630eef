"""Standstill detection from measured positions with a tolerance.

Two measurements of a standing robot differ by up to twice the tolerance. A robot rests if it has *arrived*:
all setpoints that it may still follow are equal, and it is measured there. A robot that stands elsewhere
(pushed, held by a brake) rests if its measurements have stayed within twice the tolerance of one of them for
long enough. Over k ticks it then moved by no more than four tolerances. k is the number of ticks for which
that is a speed of 1e-6 rad or m per tick, and it is limited to half a second.
"""

from armgate.events import Joints

STILL = 1e-6
"""Motion in one tick that counts as rest, rad or m: the exponential decay of a lag never reaches zero."""

_LONGEST = 0.5
"""Longest time for which the measurements must stay, s."""


class StandstillDetector:
    """Counter of the ticks for which a robot was measured in one place.

    Args:
        tolerance: Largest error of a measurement, rad or m.
        period: Time between two ticks, s.
    """

    def __init__(self, tolerance: float, period: float) -> None:
        self._room = 2.0 * tolerance + STILL
        self._needed = max(1, round(min(4.0 * tolerance / STILL, _LONGEST / period)))
        self._place: Joints | None = None
        self._ticks = 0

    @property
    def reached(self) -> bool:
        """True if the robot has stayed in one place for long enough."""
        return self._ticks >= self._needed

    def restart(self) -> None:
        """Count from the beginning: a standing robot may not yet have begun to follow its setpoint."""
        self._place, self._ticks = None, 0

    def add(self, q: Joints) -> None:
        """Count the measured position of one more tick."""
        if self._place is not None and within(q, self._place, self._room):
            self._ticks += 1
        else:
            self._place, self._ticks = q, 0


def within(a: Joints, b: Joints, room: float) -> bool:
    """Return True if no joint of ``a`` is farther than ``room`` from ``b``."""
    for x, y in zip(a, b, strict=True):  # noqa: SIM110 (faster than all)
        if not abs(x - y) <= room:
            return False
    return True
