"""Size of the probe: the shortest one visible in telegrams, within tolerance, speed and acceleration."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from armgate.events import Joints
from armgate.links.rsi.axes import Axis

if TYPE_CHECKING:  # `setup` imports this package, to check the size of the probe
    from armgate.links.rsi.setup import Setup

_EXCURSION = {False: math.radians(0.1), True: 1e-4}
"""Largest offset of a KRC of either mode (rad; m for linear axes); tolerance and resolution may change it."""
_UNREST = {False: math.radians(1e-4), True: 1e-7}
"""Assumed motion of a robot at rest, below which finer telegrams do not help (rad; m)."""
_SHORTEST, _LONGEST = 4, 64
"""Smallest and largest number of telegrams in half a wave."""
_VISIBLE, _BARELY = 25.0, 8.0
"""Wanted amplitude, and smallest usable one, in steps of the telegrams' last decimal."""


@dataclass(frozen=True, slots=True)
class ProbeSize:
    """Size of the probe.

    Attributes:
        half: Telegrams in half a wave.
        amplitude: Of each axis, rad or m.
        resolution: Of each axis's measured position, rad or m.
        farthest: Largest offset of each axis at a KRC of either mode, rad or m.
    """

    half: int
    amplitude: Joints
    resolution: Joints
    farthest: Joints

    def objection(self, axes: Sequence[Axis], precision: int) -> str | None:
        """Return the reason why the probe would be invisible in telegrams, None if it is visible."""
        for axis, amplitude, step in zip(axes, self.amplitude, self.resolution, strict=True):
            if amplitude < _BARELY * step:
                at, of = axis.shown * amplitude, axis.shown * step
                return (
                    f"a probe of {axis.name} by {at:.2g} {axis.unit} is not visible in steps of {of:.2g} "
                    f"{axis.unit} (precision {precision}): the mode of the KRC could not be proven; expected "
                    f"precision {precision + 1} or more, on the KRC too, or a wider tolerance"
                )
        return None


def probe_size(setup: "Setup") -> ProbeSize:
    """Return the size of a robot's probe.

    A short probe is seldom disturbed by a lost telegram, a long one is damped less by the lag.
    """
    half = _SHORTEST
    best = _sized(setup, half)
    while half < _LONGEST and _visibility(setup, best) < _VISIBLE:
        half = min(half + half // 2, _LONGEST)
        best = max(best, _sized(setup, half), key=lambda size: _visibility(setup, size))
    return best


def _visibility(setup: "Setup", size: ProbeSize) -> float:
    """Return the smallest measured amplitude, in steps of telegrams or of the motion of a robot at rest.

    A first-order lag T damps a wave of half-length h (both in s) to about h / (π T), at most 1.
    """
    damping = min(size.half * setup.period / (math.pi * max(setup.lag, 1e-9)), 1.0)
    rows = zip(setup.axes, size.amplitude, size.resolution, strict=True)
    return damping * min(far / max(step, _UNREST[axis.linear]) for axis, far, step in rows)


def _sized(setup: "Setup", half: int) -> ProbeSize:
    """Return the probe with half a wave of this number of telegrams.

    Its corrections are a·sin(π k / half); their running sum reaches a·cot(π / (2·half)).
    """
    first, total = math.sin(math.pi / half), 1.0 / math.tan(math.pi / (2 * half))
    rows = zip(setup.axes, setup.tolerance, setup.speed, setup.acceleration, strict=True)
    amplitudes, steps = [], []
    for axis, tolerance, speed, acceleration in rows:
        step = 10.0**-setup.precision * abs(axis.read)
        wanted = max(_EXCURSION[axis.linear] / total, _VISIBLE * step)
        hardest = 0.5 * acceleration * setup.period**2 / first
        amplitudes.append(min(wanted, 0.5 * tolerance / total, hardest, 0.5 * speed * setup.period))
        steps.append(step)
    return ProbeSize(half, tuple(amplitudes), tuple(steps), tuple(total * one for one in amplitudes))
