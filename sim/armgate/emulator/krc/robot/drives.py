"""Drives: they follow setpoints without smoothing, or report a fault."""

import math
from collections.abc import Sequence

from armgate.emulator.krc.profile import Tolerance
from armgate.emulator.krc.robot.arm import Axis


class Drives:
    """Drives of all axes, which compare each setpoint with the limits of the axes.

    Args:
        axes: The axes.
        tolerance: Factors by which the drives exceed the figures of the axes.
        cycle: Time of a cycle, s.
        setpoint: Initial setpoint, at rest, deg or mm.
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
        """Rest at a setpoint: velocity and filtered acceleration become zero."""
        self.setpoint = tuple(setpoint)
        self._velocity = (0.0,) * len(self._axes)
        self._filtered = self._velocity

    @property
    def load(self) -> tuple[float, ...]:
        """Filtered acceleration of each axis, as a share of the axis's largest one."""
        return tuple(f / axis.acceleration for f, axis in zip(self._filtered, self._axes, strict=True))

    def move(self, setpoint: Sequence[float]) -> str | None:
        """Move to the setpoint of the next cycle; if a drive reports a fault, return it and do not move."""
        cycle, gain = self._cycle, self._gain
        velocity = tuple((new - old) / cycle for new, old in zip(setpoint, self.setpoint, strict=True))
        filtered = tuple(
            f + gain * ((v - w) / cycle - f)
            for f, v, w in zip(self._filtered, velocity, self._velocity, strict=True)
        )
        for axis, new, old, v, f in zip(self._axes, setpoint, self.setpoint, velocity, filtered, strict=True):
            fault = self._fault(axis, new, old, v, f)
            if fault is not None:
                return fault
        self.setpoint, self._velocity, self._filtered = tuple(setpoint), velocity, filtered
        return None

    def _fault(self, axis: Axis, new: float, old: float, velocity: float, filtered: float) -> str | None:
        unit, tolerance = axis.unit, self._tolerance
        fastest, hardest = tolerance.velocity * axis.speed, tolerance.acceleration * axis.acceleration
        if abs(velocity) > fastest:
            return f"Command velocity {axis.name}: {velocity:.1f} {unit}/s; its drive allows {fastest:.1f}"
        if abs(filtered) > hardest:
            return (
                f"Command gear torque {axis.name}: {filtered:.1f} {unit}/s² filtered; "
                f"its drive allows {hardest:.1f}"
            )
        # An axis outside its range may still move back.
        if (new > axis.upper and new > old) or (new < axis.lower and new < old):
            return (
                f"Software limit switch {axis.name}: {new:.3f} {unit}; "
                f"its range is {axis.lower:g} to {axis.upper:g}"
            )
        return None
