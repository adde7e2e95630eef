"""Whether a KRC and the configuration agree: numbers, times and positions, before anything moves."""

import math

from armgate.events import Joints
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Setup, uncovered
from armgate.links.rsi.telegram import Telegram

_TELEGRAMS = 10
"""So many in a row have to agree."""
_PATIENCE = 3.0
"""After so long without agreement the link gives up, s."""
_SHORTEST, _LONGEST = 0.75, 1.75
"""The time between telegrams, on average, in periods of the cell. A robot that ticks faster than the cell
believes is too fast; one that ticks slower is only slow, as a KRC that shares a busy machine is."""
_UNITS = 180.0 / math.pi
"""What RSI 2 multiplies the mm of linear axes with."""


class Agreement:
    """Gathers evidence while a link synchronises.

    Args:
        setup: Robot and KRC.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self.begin()

    def begin(self) -> None:
        """Begin anew."""
        self._since: float | None = None
        self._first = 0.0
        self._count = 0
        self._decimals = 0

    def take(self, commanded: SetpointTracker, q: Joints, clean: bool, now: float) -> str | None:
        """A telegram more.

        Returns:
            Empty if all agrees, a text if it does not, None while that is open.
        """
        self._since = now if self._since is None else self._since
        if not clean or self._count == 0:
            self._first, self._count = now, 1
            lacking: str | None = "telegrams do not come one after the other, answered in time"
        else:
            self._count += 1
            lacking = self._lacking(commanded, q, now)
        if lacking is None:
            objection = uncovered(self._setup, commanded.reference)
            return "" if objection is None else objection
        return lacking if now - self._since > _PATIENCE else None

    def misplaced(self, reference: Joints, q: Joints) -> str | None:
        """What speaks against a reference at the first telegram: the robot has to be there."""
        where = self.astray(reference, q)
        return None if where is None else f"{where} when the program began: not answered; start it anew"

    def astray(self, expected: Joints, q: Joints) -> str | None:
        """Which axis is not where it should be, if one is."""
        rows = zip(self._setup.axes, expected, q, self._setup.tolerance, strict=True)
        for axis, wanted, measured, tolerance in rows:
            if abs(wanted - measured) > tolerance:
                at, should = axis.shown * measured, axis.shown * wanted
                return f"{axis.name} is at {at:.2f} {axis.unit}, and should be at {should:.2f}"
        return None

    def hints(self, telegram: Telegram, ended: bool) -> list[str]:
        """Return known mistakes that show in a telegram.

        Args:
            telegram: The telegram.
            ended: True if it is the last one: the robot has been moved, so that decimals that a KRC prints
                show, even if it prints none that are zero.
        """
        found = []
        self._decimals = max(self._decimals, telegram.decimals())
        if ended and self._decimals < min(self._setup.precision, 3):
            found.append(
                f"the KRC sends {self._decimals} decimal(s), the cell says {self._setup.precision}: "
                "set Precision in the KRC's Ethernet object"
            )
        for axis, value, low, high in zip(
            self._setup.axes, telegram.q, self._setup.lower, self._setup.upper, strict=True
        ):
            if axis.linear and not low <= value <= high and low <= value / _UNITS <= high:
                found.append(
                    f"{axis.name} reads {1000 * value:.1f} mm, which divided by 180/π is inside its travel: "
                    f"set axes.{axis.name}.received to {_UNITS:.9f}"
                )
        return found

    def _lacking(self, commanded: SetpointTracker, q: Joints, now: float) -> str | None:
        if self._count < _TELEGRAMS:
            return "telegrams do not come one after the other, answered in time"
        cycle = (now - self._first) / (self._count - 1)
        if not _SHORTEST <= cycle / self._setup.period <= _LONGEST:
            times = f"every {1000 * cycle:.1f} ms, the cell's period is {1000 * self._setup.period:g} ms"
            return f"telegrams come {times}: expected the same"
        return self.astray(commanded.setpoint, q)
