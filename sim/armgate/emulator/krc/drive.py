"""The drives: they follow setpoints unsmoothed, or give up."""

import math
from collections.abc import Sequence

from armgate.emulator.krc.arm import Axis
from armgate.emulator.krc.profile import Tolerance


class Drives:
    """Holds each setpoint against what the axes can do.

    Args:
        axes: The axes.
        tolerance: How far beyond the axes' own figures the drives go.
        cycle: s.
        setpoint: At the start, at rest; deg or mm.
    """

    def __init__(
        self, axes: Sequence[Axis], tolerance: Tolerance, cycle: float, setpoint: Sequence[float]
    ) -> None:
        self._axes = tuple(axes)
        self._tolerance = tolerance
        self._cycle = cycle
        self._gain = -math.expm1(-cycle / tolerance.filter)
        self.rest(setpoint)

    def rest(self, setpoint: Sequence[float]) -> None:
        """Stand still at a setpoint."""
        self.setpoint = tuple(setpoint)
        self._velocity = (0.0,) * len(self._axes)
        self._filtered = self._velocity

    @property
    def load(self) -> tuple[float, ...]:
        """Filtered acceleration of each axis, as a share of the axis's own."""
        return tuple(f / axis.acceleration for f, axis in zip(self._filtered, self._axes, strict=True))

    def take(self, setpoint: Sequence[float]) -> str | None:
        """The next cycle's setpoint; what the drives complain of, if they do: then they stay."""
        cycle, gain = self._cycle, self._gain
        velocity = tuple((new - old) / cycle for new, old in zip(setpoint, self.setpoint, strict=True))
        filtered = tuple(
            f + gain * ((v - w) / cycle - f)
            for f, v, w in zip(self._filtered, velocity, self._velocity, strict=True)
        )
        for axis, new, old, v, f in zip(self._axes, setpoint, self.setpoint, velocity, filtered, strict=True):
            complaint = self._complaint(axis, new, old, v, f)
            if complaint is not None:
                return complaint
        self.setpoint, self._velocity, self._filtered = tuple(setpoint), velocity, filtered
        return None

    def _complaint(self, axis: Axis, new: float, old: float, velocity: float, filtered: float) -> str | None:
        unit, bears = axis.unit, self._tolerance
        fastest, hardest = bears.velocity * axis.speed, bears.acceleration * axis.acceleration
        if abs(velocity) > fastest:
            return f"Command velocity {axis.name}: {velocity:.1f} {unit}/s; its drive bears {fastest:.1f}"
        if abs(filtered) > hardest:
            return (
                f"Command gear torque {axis.name}: {filtered:.1f} {unit}/s² filtered; "
                f"its drive bears {hardest:.1f}"
            )
        # Outside its range an axis may still come back.
        if (new > axis.upper and new > old) or (new < axis.lower and new < old):
            return (
                f"Software limit switch {axis.name}: {new:.3f} {unit}; "
                f"its range is {axis.lower:g} to {axis.upper:g}"
            )
        return None
