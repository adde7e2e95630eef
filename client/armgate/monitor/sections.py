"""Typed access to the mappings of a configuration; errors name the place."""

from collections.abc import Iterator, Sequence
from typing import Any

from armgate.monitor.errors import DescriptionError
from armgate.monitor.frames import Array, placement
from armgate.monitor.quantities import si


class Section:
    """One mapping of the configuration and its place, such as ``robots.FR.base``."""

    def __init__(self, values: object, where: str) -> None:
        if not isinstance(values, dict):
            raise DescriptionError(f"{where}: expected a mapping")
        self.values: dict[str, Any] = values
        self.where = where

    def place(self, key: str) -> str:
        """Return the place of a key."""
        return f"{self.where}.{key}" if self.where else key

    def only(self, *keys: str) -> None:
        """Refuse keys that the monitor does not know."""
        unknown = sorted(set(self.values) - set(keys))
        if unknown:
            raise DescriptionError(f"{self.place(unknown[0])}: this key is unknown to the monitor")

    def section(self, key: str) -> "Section":
        """Return the mapping under a key, an empty one if it is left out."""
        return Section({} if self.values.get(key) is None else self.values[key], self.place(key))

    def sections(self, key: str) -> Iterator[tuple[str, "Section"]]:
        """Yield names and mappings of a mapping of mappings."""
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
        """Return as many quantities as the default has."""
        value = self.values.get(key, list(default))
        if not isinstance(value, list) or len(value) != len(default):
            raise DescriptionError(f"{self.place(key)}: {value!r:.80}; expected {len(default)} numbers")
        return [si(item, f"{self.place(key)}.{i}", dimension) for i, item in enumerate(value)]

    def pose(self) -> Array:
        """Return the placement of ``xyz`` and ``rpy``."""
        zeros = (0.0, 0.0, 0.0)
        return placement(self.numbers("xyz", zeros, "length"), self.numbers("rpy", zeros, "angle"))
