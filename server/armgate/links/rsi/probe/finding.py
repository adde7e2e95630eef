"""Finding of the probe: mode, order, sign and scale from the areas below the measured offsets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armgate.events import Joints
from armgate.links.rsi.axes import Axis

if TYPE_CHECKING:  # `setup` imports this package, to check the size of the probe
    from armgate.links.rsi.setup import Setup

_FOLLOWS = 0.05
"""Smallest extent of an axis that follows, beyond noise, as a share of the wave's extent."""
_ADDS = 0.3
"""Smallest area of an axis that adds up, as a share of a relative KRC's area."""
_MATCHES = 0.25
"""Largest error of a round's share, in gains."""
_EXACT, _COARSE = 0.05, 36.0
"""Accepted error of a gain: a constant, and a number of steps of the position in the area of a round."""
_GAP = 0.05
"""Accepted error of a gain for each telegram that was missed."""


@dataclass(frozen=True, slots=True)
class RoundSums:
    """Sums over the telegrams of one round.

    Attributes:
        areas: Sum of each axis's measured offset, rad or m.
        extents: Sum of its magnitude beyond noise.
        held: Sum of the commanded offset, in amplitudes.
    """

    areas: Joints
    extents: Joints
    held: float


@dataclass(frozen=True, slots=True)
class Measurement:
    """Motion of one axis in the rounds.

    Attributes:
        adds: Area in the first round, as a share of a relative KRC's.
        extent: Extent of the motion in the first round beyond noise, as a share of the wave's.
        shares: Area in each later round, as a share of what the cell's mode predicts.
        error: Accepted error of a share.
    """

    adds: float
    extent: float
    shares: tuple[float, ...]
    error: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Evaluation of the rounds so far.

    Attributes:
        setup: Robot and KRC.
        amplitude: Of each axis, rad or m.
        codes: Digits of each axis in the later rounds.
        area: Area of a relative KRC's offsets in the first round, in amplitudes.
        extent: Extent of the wave, in amplitudes.
    """

    setup: "Setup"
    amplitude: Joints
    codes: tuple[tuple[int, ...], ...]
    area: float
    extent: float

    def measurement(self, number: int, sums: Sequence[RoundSums], noise: float, missed: int) -> Measurement:
        """Return the motion of an axis.

        Args:
            number: Number of the axis.
            sums: Sums of the rounds.
            noise: Noise of its position at rest, or its resolution if that is larger, rad or m.
            missed: Number of telegrams that were missed.
        """
        amplitude = self.amplitude[number]
        first, *later = sums
        return Measurement(
            adds=first.areas[number] / (amplitude * self.area),
            extent=first.extents[number] / (amplitude * self.extent),
            shares=tuple(one.areas[number] / (amplitude * one.held) for one in later),
            error=_EXACT + _GAP * missed + _COARSE * noise / (amplitude * self.area),
        )

    def mode_objection(self, measurements: Sequence[Measurement]) -> str | None:
        """Return the objection of the first round to the cell's mode, None if it proves the mode."""
        relative = self.setup.relative
        for number, (axis, found) in enumerate(zip(self.setup.axes, measurements, strict=True)):
            adds = abs(found.adds) > _ADDS
            if adds and not relative:
                return (
                    f"{axis.name} adds corrections up: the KRC's program calls RSI_ON(#RELATIVE), the cell "
                    f"has mode: absolute. Make them the same, and start the program anew"
                )
            if not adds and found.extent < _FOLLOWS:
                return self._unmoved(number)
            if not adds and relative:
                return (
                    f"{axis.name} treats a correction as the whole offset: the KRC's program calls "
                    f"RSI_ON(#ABSOLUTE), the cell has mode: relative. Make them the same, and start the "
                    f"program anew"
                )
        return None

    def axis_objection(self, number: int, found: Measurement) -> str | None:
        """Return the objection of the later rounds to an axis, None if they prove it."""
        axis = self.setup.axes[number]
        gain, misfit = _fit(found.shares, self.codes[number])
        if gain > 0.0 and misfit <= _MATCHES:
            return None if abs(gain - 1.0) <= found.error else _scale_objection(axis, gain)
        for other, code in zip(self.setup.axes, self.codes, strict=True):
            gain, misfit = _fit(found.shares, code)
            if abs(gain) < _MATCHES or misfit > _MATCHES:
                continue
            if other is axis:
                return (
                    f"{axis.name} is measured to move against its correction: expected "
                    f"axes.{axis.name}.received and sent to have the same sign"
                )
            return (
                f"{axis.name} is measured to move when {other.name} is corrected: expected the same order of "
                f"axes in RECEIVE, in the KRC's signal flow and in axes"
            )
        return self._unmoved(number)

    def _unmoved(self, number: int) -> str:
        axis, far = self.setup.axes[number], self.amplitude[number]
        return (
            f"{axis.name} is not measured to follow a correction of {axis.shown * far:.2g} {axis.unit}: "
            f"check the tags in RECEIVE on the KRC, that the feedback is not frozen, and that it has at "
            f"least {self.setup.precision} decimals (precision). Then start the program anew"
        )


def _scale_objection(axis: Axis, gain: float) -> str:
    """Return the objection to an axis that moves by another factor than commanded."""
    received, sent = axis.received * gain, axis.sending / gain
    return (
        f"{axis.name} ({axis.joint}) is measured to move by {gain:.3f} of the commanded motion: expected "
        f"axes.{axis.name}.received {received:.6g} instead of {axis.received:.6g}, or sent {sent:.6g} "
        f"instead of {axis.sending:.6g}"
    )


def _fit(shares: Sequence[float], code: Sequence[int]) -> tuple[float, float]:
    """Return the least-squares gain g of a code for the shares, and the largest error over max(|g|, 1)."""
    gain = sum(a * b for a, b in zip(shares, code, strict=True)) / sum(b * b for b in code)
    errors = [abs(a - gain * b) for a, b in zip(shares, code, strict=True)]
    return gain, max(errors) / max(abs(gain), 1.0)
