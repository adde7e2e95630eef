"""Typed access to the mappings of a configuration and to its numbers; errors name the place.

Numbers are bare in SI units (rad, m, s), or texts with a unit such as ``-94 deg``.
"""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from armgate.monitor.errors import DescriptionError
from armgate.monitor.transforms import Array, placement

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
        given: Value in the file.
        where: Its place, for the error.
        dimension: ``angle``, ``length`` or ``time``; a bare number is valid for each.
        rate: 0 for a position, 1 for a value per second, 2 for one per second squared.

    Raises:
        DescriptionError: It is not a finite number of this dimension.
    """
    if isinstance(given, int | float) and not isinstance(given, bool):
        return finite(given, where)
    if not isinstance(given, str) or len(given) > _LONGEST:
        _reject(given, where, dimension)
    match = _FORM.fullmatch(given.strip())
    if match is None:
        _reject(given, where, dimension)
    number, unit, per = match[1], match[2], match[3] or ""
    factor = _FACTORS.get(unit)
    if factor is None or factor[0] != dimension or _RATES.get(per) != rate:
        _reject(given, where, dimension)
    return finite(float(number) * factor[1], where)


def finite(given: object, where: str) -> float:
    """Return a finite number.

    Raises:
        DescriptionError: It is not a finite number.
    """
    try:
        if isinstance(given, int | float) and not isinstance(given, bool) and math.isfinite(given):
            return float(given)
    except OverflowError:
        pass
    raise DescriptionError(f"{where}: {given!r:.80}; expected a finite number")


def _reject(given: object, where: str, dimension: str) -> NoReturn:
    raise DescriptionError(
        f"{where}: {given!r:.80}; expected a number in SI units, or with a unit of {dimension}"
    )


class Section:
    """One mapping of the configuration, with its place such as ``robots.FR.base``."""

    def __init__(self, values: object, where: str) -> None:
        if not isinstance(values, dict):
            raise DescriptionError(f"{where}: expected a mapping")
        self.values: dict[str, Any] = values
        self.where = where

    def place(self, key: str) -> str:
        """Return the place of a key."""
        return f"{self.where}.{key}" if self.where else key

    def only(self, *keys: str) -> None:
        """Reject keys that the monitor does not support."""
        unknown = sorted(set(self.values) - set(keys))
        if unknown:
            raise DescriptionError(f"{self.place(unknown[0])}: the monitor does not support this key")

    def section(self, key: str) -> "Section":
        """Return the mapping under a key; an empty one if the key is missing."""
        return Section({} if self.values.get(key) is None else self.values[key], self.place(key))

    def sections(self, key: str) -> Iterator[tuple[str, "Section"]]:
        """Yield the names and values of a mapping of mappings."""
        own = self.section(key)
        for name in own.values:
            yield name, Section(own.values[name], own.place(name))

    def text(self, key: str, default: str) -> str:
        """Return a text."""
        value = self.values.get(key, default)
        if not isinstance(value, str):
            raise DescriptionError(f"{self.place(key)}: {value!r:.80}; expected a text")
        return value

    def number(self, key: str, default: float, dimension: str, rate: int = 0) -> float:
        """Return a quantity in SI units."""
        value = self.values.get(key)
        return default if value is None else si(value, self.place(key), dimension, rate)

    def numbers(self, key: str, default: Sequence[float], dimension: str) -> list[float]:
        """Return a list of quantities in SI units, as long as the default."""
        value = self.values.get(key, list(default))
        if not isinstance(value, list) or len(value) != len(default):
            raise DescriptionError(f"{self.place(key)}: {value!r:.80}; expected {len(default)} numbers")
        return [si(item, f"{self.place(key)}.{i}", dimension) for i, item in enumerate(value)]

    def pose(self) -> Array:
        """Return the placement that ``xyz`` and ``rpy`` define."""
        zeros = (0.0, 0.0, 0.0)
        return placement(self.numbers("xyz", zeros, "length"), self.numbers("rpy", zeros, "angle"))
