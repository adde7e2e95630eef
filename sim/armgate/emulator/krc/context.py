"""What on a real KRC the RSI context and the KRL program say: the mode and the objects' parameters."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.ethernet import A_AXES, E_AXES

AXISCORR = 5.0
"""Largest correction where AXISCORR says nothing, deg or mm."""
AXISCORRMON = 6.0
"""Largest correction where AXISCORRMON says nothing, or is absent, deg or mm."""
TIMEOUT = 10
"""Late cycles that are borne where the Ethernet object says nothing."""


class Mode(StrEnum):
    """How a correction is meant (RSI_ON)."""

    ABSOLUTE = "absolute"
    RELATIVE = "relative"


class Limits:
    """A bound on the correction of each axis, ± deg or mm.

    Args:
        default: Of every axis that is not named.
        own: By axis.
    """

    def __init__(self, default: float, own: Mapping[str, float] | None = None) -> None:
        self._default = default
        self._own = dict(own or {})

    def __getitem__(self, axis: str) -> float:
        return self._own.get(axis, self._default)

    @classmethod
    def from_text(cls, text: str, default: float) -> "Limits":
        """``170`` for all axes, or ``A=170,E=2000,A6=350``: groups first, single axes after them.

        Raises:
            KrcError: Anything else.
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
                raise KrcError(f"limit {text!r}; expected one number, as 1.5, or every name once: A=1.5,E=2")
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
    """One RSI context.

    Attributes:
        mode: ABSOLUTE: a value is the whole offset. RELATIVE: it is added in every cycle.
        precision: Decimals in telegrams. One is KUKA's default.
        timeout: How many late cycles, counted since the start, are borne.
        limits: AXISCORR: corrections beyond it are cut, and nobody is told.
        monitor: AXISCORRMON: beyond it RSI stops.
        aspos_moves: ASPos, ESPos and RSol follow the correction. On a real KR 16-2 they keep the programmed
            position; some simulators move them.
    """

    mode: Mode = Mode.ABSOLUTE
    precision: int = 1
    timeout: int = TIMEOUT
    limits: Limits = field(default_factory=lambda: Limits(AXISCORR))
    monitor: Limits = field(default_factory=lambda: Limits(AXISCORRMON))
    aspos_moves: bool = False
