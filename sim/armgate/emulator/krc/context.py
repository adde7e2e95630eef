"""RSI context of a virtual KRC: the mode of RSI_ON and the parameters of the RSI objects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.rsi.ethernet import A_AXES, E_AXES

AXISCORR = 5.0
"""Default of AXISCORR: correction beyond which the value is limited, deg or mm."""
AXISCORRMON = 6.0
"""Default of AXISCORRMON, also if the object is absent: correction beyond which RSI stops, deg or mm."""
TIMEOUT = 10
"""Default of the Ethernet object's Timeout: tolerated number of late cycles."""


class Mode(StrEnum):
    """Meaning of a correction (RSI_ON)."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"


class Limits:
    """Bounds on the correction of each axis, ± deg or mm.

    Args:
        default: Bound of every axis that has none of its own.
        own: Bounds by axis.
    """

    def __init__(self, default: float, own: Mapping[str, float] | None = None) -> None:
        self._default = default
        self._own = dict(own or {})

    def __getitem__(self, axis: str) -> float:
        return self._own.get(axis, self._default)

    @classmethod
    def from_text(cls, text: str, default: float) -> "Limits":
        """Read ``170`` (all axes) or ``A=170,E=2000,A6=350`` (groups first, then single axes).

        Raises:
            KrcError: The text has another form.
        """
        own: dict[str, float] = {}
        names: list[str] = []
        for part in text.split(","):
            name, equals, number = part.strip().rpartition("=")
            axes = _axes(name) if equals else (*A_AXES, *E_AXES)
            value = _positive(number)
            if not axes or value is None:
                raise KrcError(f"limit {part.strip()!r}; expected a number above 0, or A=…, E=…, A1=…")
            if name in names or (names and not equals):
                raise KrcError(
                    f"limit {text!r}; expected one number, such as 1.5, or every name once: A=1.5,E=2"
                )
            names.append(name)
            own.update(dict.fromkeys(axes, value))
        return cls(default, own)


def _axes(name: str) -> tuple[str, ...]:
    groups = {"A": A_AXES, "E": E_AXES}
    return groups.get(name) or ((name,) if name in (*A_AXES, *E_AXES) else ())


def _positive(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None


@dataclass(frozen=True)
class Context:
    """RSI context.

    Attributes:
        mode: ABSOLUTE: a value is the whole offset. RELATIVE: a value is added in every cycle.
        precision: Decimals in telegrams; KUKA's default is one.
        timeout: Tolerated number of late cycles since the start.
        limits: AXISCORR: corrections beyond it are limited without notice.
        monitor: AXISCORRMON: beyond it RSI stops.
        aspos_moves: True if ASPos, ESPos and RSol follow the correction. On a real KR 16-2 they keep the
            programmed position; some simulators move them.
    """

    mode: Mode = Mode.ABSOLUTE
    precision: int = 1
    timeout: int = TIMEOUT
    limits: Limits = field(default_factory=lambda: Limits(AXISCORR))
    monitor: Limits = field(default_factory=lambda: Limits(AXISCORRMON))
    aspos_moves: bool = False
