"""Numbers of the configuration: bare in SI units (rad, m, s), or texts with a unit such as ``-94 deg``."""

import math
import re
from typing import NoReturn

from armgate.monitor.errors import DescriptionError

_FACTORS = {
    "rad": ("angle", 1.0), "deg": ("angle", math.pi / 180.0), "°": ("angle", math.pi / 180.0),
    "m": ("length", 1.0), "cm": ("length", 0.01), "mm": ("length", 0.001),
    "s": ("time", 1.0), "ms": ("time", 0.001),
}  # fmt: skip
_RATES = {"": 0, "/s": 1, "/s2": 2, "/s^2": 2, "/s²": 2}
_FORM = re.compile(r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*([a-z°]+)(/s(?:2|\^2|²)?)?")
_LONGEST = 64


def si(given: object, where: str, dimension: str, rate: int = 0) -> float:
    """Return a number, or a text with a unit, in SI units.

    Args:
        given: What the file holds.
        where: Its place, for the error.
        dimension: ``angle``, ``length`` or ``time``; a bare number fits each.
        rate: 0 for a position, 1 for a value per second, 2 for one per second squared.

    Raises:
        DescriptionError: It is no finite number of this dimension.
    """
    if isinstance(given, int | float) and not isinstance(given, bool):
        return finite(given, where)
    if not isinstance(given, str) or len(given) > _LONGEST:
        _refuse(given, where, dimension)
    match = _FORM.fullmatch(given.strip())
    if match is None:
        _refuse(given, where, dimension)
    number, unit, per = match[1], match[2], match[3] or ""
    factor = _FACTORS.get(unit)
    if factor is None or factor[0] != dimension or _RATES.get(per) != rate:
        _refuse(given, where, dimension)
    return finite(float(number) * factor[1], where)


def finite(given: object, where: str) -> float:
    """Return a finite number.

    Raises:
        DescriptionError: It is none.
    """
    try:
        if isinstance(given, int | float) and not isinstance(given, bool) and math.isfinite(given):
            return float(given)
    except OverflowError:
        pass
    raise DescriptionError(f"{where}: {given!r:.80}; expected a finite number")


def _refuse(given: object, where: str, dimension: str) -> NoReturn:
    raise DescriptionError(
        f"{where}: {given!r:.80}; expected a number in SI units, or with a unit of {dimension}"
    )
