"""RSI objects AXISCORR and AXISCORRMON: the offset of each axis from received values."""

from collections.abc import Sequence
from typing import assert_never

from armgate.emulator.krc.context import Context, Mode


class Correction:
    """Offset of each axis from the programmed position.

    Args:
        names: Names of the axes.
        context: Mode and limits.
    """

    def __init__(self, names: Sequence[str], context: Context) -> None:
        self._names = tuple(names)
        self.mode = context.mode
        """Meaning of the values."""
        self._limits = tuple(context.limits[name] for name in names)
        self._monitor = tuple(context.monitor[name] for name in names)
        self.offset = (0.0,) * len(self._names)
        """Offset of each axis, deg or mm."""

    def apply(self, values: Sequence[float]) -> str | None:
        """Apply the values of a cycle; return the message of AXISCORRMON if a limit is exceeded.

        AXISCORR limits without notice: the robot then moves less than the PC requests.
        """
        self.offset = tuple(
            min(max(one, -limit), limit)
            for one, limit in zip(self._wanted(values), self._limits, strict=True)
        )
        for name, offset, limit in zip(self._names, self.offset, self._monitor, strict=True):
            if abs(offset) > limit:
                return f"{name} is corrected by {offset:g}, AXISCORRMON allows ±{limit:g}"
        return None

    def _wanted(self, values: Sequence[float]) -> Sequence[float]:
        match self.mode:
            case Mode.ABSOLUTE:
                return values
            case Mode.RELATIVE:
                return [offset + value for offset, value in zip(self.offset, values, strict=True)]
            case _:
                assert_never(self.mode)
