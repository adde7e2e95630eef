"""Survey of a KRC without answering it: cycle, elements, units, directions of the axes."""

import math
import xml.etree.ElementTree as ET

import numpy as np

from armgate.links.rsi.axes import Axis
from armgate.links.rsi.commissioning.axis_directions import AxisDirections, FlangeInFoot
from armgate.links.rsi.setup import Setup
from armgate.links.rsi.telegram import Telegram, TelegramError, TelegramReader

_MOVED = 0.5
"""Smallest motion that counts as jogging, deg or mm."""
_RSI2_LINEAR = 180.0 / math.pi
"""Factor by which RSI 2 multiplies the mm of linear axes."""


class Survey:
    """Survey of the telegrams of one KRC.

    Args:
        setup: Robot and KRC.
        flange: The model's flange.

    Attributes:
        problems: Problems that were found, each once.
        sources: Addresses that sent datagrams.
    """

    def __init__(self, setup: Setup, flange: FlangeInFoot) -> None:
        self._setup = setup
        self._directions = AxisDirections(setup, flange)
        self._reader = TelegramReader(setup.axes, programmed=setup.programmed)
        self._times: list[float] = []
        self._ipocs: list[int] = []
        self._q: list[tuple[float, ...]] = []
        self._first: Telegram | None = None
        self._last: Telegram | None = None
        self.problems: list[str] = []
        self.sources: set[str] = set()

    def take(self, data: bytes, host: str, now: float) -> None:
        """Take a datagram that this host sent, and that arrived at this time, s."""
        self.sources.add(host)
        if host != self._setup.krc:
            return self._add_problem(f"datagrams come from {host}; the cell has krc: {self._setup.krc}")
        try:
            telegram = self._reader.read(data)
            if telegram.short:
                return None
        except TelegramError as error:
            return self._add_problem(f"a telegram does not fit: {error}")
        self._first, self._last = self._first or telegram, telegram
        self._times.append(now)
        self._ipocs.append(telegram.ipoc)
        self._q.append(telegram.q)
        self._directions.take(telegram.q, data)
        return None

    def report(self) -> list[str]:
        """Return the findings, one per line; ``problems`` is complete only afterwards."""
        if self._first is None or self._last is None:
            return ["no telegram came"]
        lines = [*self._timing(), f"elements: {', '.join(_elements(self._first.data))}"]
        lines.append(f"decimals: {self._last.decimals()} (the cell has precision {self._setup.precision})")
        if self._last.decimals() < min(self._setup.precision, 3):
            self._add_problem("set Precision in the KRC's Ethernet object")
        lines += self._axes()
        line, problem = self._directions.report()
        if problem is not None:
            self._add_problem(problem)
        return [*lines, line]

    # --- parts of the report ------------------------------------------------------------------------------

    def _timing(self) -> list[str]:
        count, first, last = len(self._times), self._first, self._last
        lines = [f"telegrams: {count}, Delay {first.delay if first else 0} to {last.delay if last else 0}"]
        if count < 3:
            return [*lines, "too few telegrams for a cycle"]
        gaps = np.diff(self._times)
        cycle, worst = float(np.median(gaps)), float(np.max(np.abs(gaps - np.median(gaps))))
        steps = sorted(set(np.diff(np.array(self._ipocs, dtype=object))))
        lines.append(f"cycle: {1000 * cycle:.2f} ms, jitter up to {1000 * worst:.2f} ms")
        lines.append(f"IPOC: from {self._ipocs[0]}, in steps of {', '.join(map(str, steps[:4]))}")
        if abs(cycle - self._setup.period) > 0.25 * self._setup.period:
            self._add_problem(
                f"the cell's period is {1000 * self._setup.period:g} ms, "
                f"the KRC's cycle is {1000 * cycle:.1f} ms"
            )
        return lines

    def _axes(self) -> list[str]:
        rows = zip(
            self._setup.axes, self._q[0], self._q[-1], self._setup.lower, self._setup.upper, strict=True
        )
        return [self._axis(*row) for row in rows]

    def _axis(self, axis: Axis, begun: float, now: float, lower: float, upper: float) -> str:
        at, low, high = (axis.shown * value for value in (now, lower, upper))
        if not lower <= now <= upper:
            hint = ""
            if axis.linear and lower <= now / _RSI2_LINEAR <= upper:
                mm = at / _RSI2_LINEAR
                hint = f": as mm·180/π it would be {mm:.2f} mm; set received to {_RSI2_LINEAR:.9f}"
            self._add_problem(f"{axis.name} is outside the limits of {axis.joint}{hint}")
        moved = axis.shown * (now - begun)
        jogged = f", moved by {moved:+.2f}" if abs(moved) > _MOVED else ""
        return f"{axis.name} {axis.joint}: {at:.2f} {axis.unit}, limits {low:g} to {high:g}{jogged}"

    def _add_problem(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)


def _elements(data: bytes) -> list[str]:
    return [child.tag for child in ET.fromstring(data)]  # noqa: S314  (it was read as a telegram before)
