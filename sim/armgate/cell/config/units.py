"""Numbers with units: ``-94 deg``, ``50 mm``, ``156 deg/s``. A bare number is in SI units (rad, m, s)."""

import math
import re
from dataclasses import dataclass

_BASE = {
    "rad": ("angle", 1.0),
    "deg": ("angle", math.pi / 180.0),
    "°": ("angle", math.pi / 180.0),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
}
_PER_TIME = {"": "", "/s": "/s", "/s2": "/s²", "/s^2": "/s²", "/s²": "/s²"}
_FORM = re.compile(
    r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z°]+)(/s(?:2|\^2|²)?)?", re.ASCII
)

UNITS = {
    "angle": "rad or deg",
    "length": "m, cm or mm",
    "time": "s or ms",
    "angle/s": "rad/s or deg/s",
    "length/s": "m/s or mm/s",
    "angle/s²": "rad/s2 or deg/s2",
    "length/s²": "m/s2 or mm/s2",
}
"""Dimensions, and the units that error messages name for them."""


def si_unit(dimension: str) -> str:
    """Return the SI unit of a dimension, such as ``rad/s`` of ``angle/s``."""
    kind, per, time = dimension.partition("/")
    return {"angle": "rad", "length": "m", "time": "s"}[kind] + per + time


@dataclass(frozen=True)
class Quantity:
    """Value in SI units.

    Attributes:
        value: Value in rad, m, s and their quotients.
        dimension: Key of ``UNITS``; None for a bare number, which fits any dimension.
        given: Value as written in the file.
    """

    value: float
    dimension: str | None
    given: float | str

    def fits(self, dimension: str) -> bool:
        """Return True if the value can be used where ``dimension`` is expected."""
        return self.dimension is None or self.dimension == dimension


def quantity(given: object) -> Quantity:
    """Read a number or a text with a unit.

    Raises:
        ValueError: It is neither, has an unknown unit, or is not finite. The text ends with the
            expectation.
    """
    if isinstance(given, Quantity):
        return given
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return Quantity(_finite(float(given), given), None, float(given))
    if isinstance(given, str):
        return _from_text(given)
    shown = "an empty value" if given is None else repr(given)
    raise ValueError(f"{shown} is not a number; expected a number or a text with a unit, such as '-94 deg'")


def _from_text(text: str) -> Quantity:
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise ValueError(
            f"cannot read {text!r}; expected a number or a number with a unit, such as '-94 deg'"
        )
    number, unit, per = match[1], match[2], match[3] or ""
    if unit not in _BASE or (per and _BASE[unit][0] == "time"):
        raise ValueError(f"unknown unit {unit + per!r}; expected one of {', '.join(UNITS.values())}")
    dimension, factor = _BASE[unit]
    return Quantity(_finite(float(number) * factor, text), dimension + _PER_TIME[per], text)


def _finite(value: float, given: object) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{given!r} is not finite; expected a finite number")
    return value


def to_si(given: object, dimension: str) -> float:
    """Return a number, or a text with a unit of this dimension, in SI units.

    Raises:
        ValueError: It cannot be read, or its unit has another dimension.
    """
    read = quantity(given)
    if not read.fits(dimension):
        kind = dimension.split("/", maxsplit=1)[0]
        article = "an" if kind == "angle" else "a"
        raise ValueError(
            f"{read.given!r} is not {article} {kind}; expected a number or a unit of {UNITS[dimension]}"
        )
    return read.value
