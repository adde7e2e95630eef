"""Agreement between a KRC and the configuration on numbers, times and positions, before anything moves."""

import math

from armgate.events import Joints
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Setup, uncovered
from armgate.links.rsi.telegram import Telegram

_TELEGRAMS = 10
"""Number of successive telegrams that have to agree."""
_TIMEOUT = 3.0
"""Time without agreement after which the link becomes faulted, s."""
_SHORTEST, _LONGEST = 0.75, 1.75
"""Bounds of the mean time between telegrams, in periods of the cell. A robot that ticks faster than the
cell assumes moves too fast. A robot that ticks more slowly only moves more slowly, for example with
a virtual KRC on a busy machine."""
_RSI2_LINEAR = 180.0 / math.pi
"""Factor by which RSI 2 multiplies the mm of linear axes."""
_UNSTEADY = f"fewer than {_TELEGRAMS} successive telegrams came and were answered in time"


class Agreement:
    """Evidence that KRC and configuration agree, gathered while a link synchronises.

    Args:
        setup: Robot and KRC.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.begin()

    def begin(self) -> None:
        """Discard the evidence."""
        self._since: float | None = None
        self._first = 0.0
        self._count = 0
        self._decimals = 0

    def take(self, commanded: SetpointTracker, q: Joints, clean: bool, now: float) -> str | None:
        """Take a telegram into account.

        Args:
            commanded: Setpoint and reference.
            q: Measured position, rad or m.
            clean: False if telegrams or replies were lost since the last one, or the robot moved.
            now: Time, s.

        Returns:
            "" if all evidence agrees, the contradiction if not, None while the evidence is incomplete.
        """
        self._since = now if self._since is None else self._since
        if not clean or self._count == 0:
            self._first, self._count = now, 1
            lacking: str | None = _UNSTEADY
        else:
            self._count += 1
            lacking = self._lacking(commanded, q, now)
        if lacking is None:
            return uncovered(self._setup, commanded.reference) or ""
        return lacking if now - self._since > _TIMEOUT else None

    def misplaced(self, reference: Joints, q: Joints) -> str | None:
        """Return the objection if the robot is not at the reference when the program begins, else None."""
        where = self.deviation(reference, q)
        if where is None:
            return None
        return f"{where} when the KRC's program began: the program gets no replies; start it anew"

    def deviation(self, expected: Joints, q: Joints) -> str | None:
        """Return a text about an axis that is not at its expected position, None if there is none."""
        rows = zip(self._setup.axes, expected, q, self._setup.tolerance, strict=True)
        for axis, wanted, measured, tolerance in rows:
            if abs(wanted - measured) > tolerance:
                at, should = axis.shown * measured, axis.shown * wanted
                return f"{axis.name} is at {at:.2f} {axis.unit}, and should be at {should:.2f}"
        return None

    def hints(self, telegram: Telegram, ended: bool) -> list[str]:
        """Return known mistakes that a telegram reveals.

        Args:
            telegram: The telegram.
            ended: True if it is the last telegram that is checked: the robot has moved, so that decimals are
                visible even if the KRC omits trailing zeros.
        """
        return [*self._decimals_hint(telegram, ended), *self._unit_hints(telegram)]

    def _decimals_hint(self, telegram: Telegram, ended: bool) -> list[str]:
        self._decimals = max(self._decimals, telegram.decimals())
        if not ended or self._decimals >= min(self._setup.precision, 3):
            return []
        return [
            f"the KRC sends {self._decimals} decimal(s), the cell has precision {self._setup.precision}: "
            "set Precision in the KRC's Ethernet object"
        ]

    def _unit_hints(self, telegram: Telegram) -> list[str]:
        rows = zip(self._setup.axes, telegram.q, self._setup.lower, self._setup.upper, strict=True)
        return [
            f"{axis.name} reads {1000 * value:.1f} mm, which divided by 180/π is inside its travel: "
            f"set axes.{axis.name}.received to {_RSI2_LINEAR:.9f}"
            for axis, value, low, high in rows
            if axis.linear and not low <= value <= high and low <= value / _RSI2_LINEAR <= high
        ]

    def _lacking(self, commanded: SetpointTracker, q: Joints, now: float) -> str | None:
        if self._count < _TELEGRAMS:
            return _UNSTEADY
        cycle = (now - self._first) / (self._count - 1)
        if not _SHORTEST <= cycle / self._setup.period <= _LONGEST:
            times = f"every {1000 * cycle:.1f} ms, the cell's period is {1000 * self._setup.period:g} ms"
            return f"telegrams come {times}: expected the same"
        return self.deviation(commanded.setpoint, q)
