"""Random values of a trial: distributions, and the random numbers of one key.

A value depends only on the seed of the trial and the key that it varies. So it does not depend on the order
of the trials, on the worker or on the other variations, and trials of different controllers with the same
seed have the same values.
"""

import hashlib
import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    model_validator,
)

from armgate.cell.config.fields import ConfigModel
from armgate.cell.config.units import quantity, si_unit

Value = bool | int | float | str | tuple[Any, ...] | None
"""Value of a key: a scalar, or a list."""


def _number(given: object) -> float:
    return quantity(given).value


Number = Annotated[float, BeforeValidator(_number)]
"""Number, or a text with a unit; in SI units."""
Interval = tuple[Number, Number]
"""Lower and upper end."""
Whole = Annotated[int, Field(ge=-(2**53), le=2**53)]
"""Whole number that a floating-point number represents exactly."""


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} is not finite; expected a finite number")
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_plain(one) for one in value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ValueError(f"{value} is a {type(value).__name__}; expected a number or a text in quotes")


Plain = Annotated[Any, AfterValidator(_plain)]
"""Value that can be written as JSON: a scalar, a list or a mapping."""


class Normal(ConfigModel):
    """Normal distribution, truncated to ``lower`` … ``upper`` if these are given."""

    mean: Number
    """Mean before truncation."""
    sigma: Annotated[Number, Field(gt=0.0)]
    """Standard deviation before truncation."""
    lower: Number | None = None
    """Smallest value."""
    upper: Number | None = None
    """Largest value."""

    @model_validator(mode="after")
    def _has_values(self) -> Self:
        if not self._share(self.lower, 0.0) < self._share(self.upper, 1.0):
            raise ValueError("no likely value between lower and upper; expected lower < upper near the mean")
        return self

    def draw(self, rng: np.random.Generator) -> float:
        """Return a value, by the inverse of the distribution function."""
        u = rng.uniform(self._share(self.lower, 0.0), self._share(self.upper, 1.0))
        tiny = 2.0**-53
        value = NormalDist(self.mean, self.sigma).inv_cdf(min(max(u, tiny), 1.0 - tiny))
        low = -math.inf if self.lower is None else self.lower
        return min(max(value, low), math.inf if self.upper is None else self.upper)

    def _share(self, bound: float | None, absent: float) -> float:
        """Return the probability of a value below a bound."""
        return absent if bound is None else NormalDist(self.mean, self.sigma).cdf(bound)


class Variation(ConfigModel):
    """Distribution of one value; exactly one key names its kind."""

    uniform: Interval | None = None
    """Uniform between two ends."""
    log_uniform: Interval | None = None
    """Uniform in the logarithm, between two positive ends."""
    integer: tuple[Whole, Whole] | None = None
    """Whole numbers from the first to the last, equally likely."""
    normal: Normal | None = None
    """Normal, truncated if bounds are given."""
    choice: Annotated[tuple[Plain, ...], Field(min_length=1)] | None = None
    """List of values, equally likely."""

    _dimension: str | None = PrivateAttr(default=None)

    @model_validator(mode="wrap")
    @classmethod
    def _with_dimension(cls, given: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        variation = handler(given)
        variation._dimension = _dimension(given)
        return variation

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = type(self).model_fields
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"{len(given)} distributions; expected exactly one of {', '.join(kinds)}")
        for ends in (self.uniform, self.log_uniform, self.integer):
            if ends is not None and ends[0] > ends[1]:
                raise ValueError(f"from {ends[0]:g} to {ends[1]:g}; expected the smaller end first")
            if ends is not None and not math.isfinite(ends[1] - ends[0]):
                raise ValueError(f"from {ends[0]:g} to {ends[1]:g} is too wide; expected a finite difference")
        if self.log_uniform is not None and self.log_uniform[0] <= 0.0:
            raise ValueError(f"log_uniform from {self.log_uniform[0]:g}; expected a positive end")
        return self

    def draw(self, rng: np.random.Generator) -> Value:
        """Return a value."""
        if self.uniform is not None:
            return float(rng.uniform(*self.uniform))
        if self.log_uniform is not None:
            low, high = self.log_uniform
            return min(max(math.exp(rng.uniform(math.log(low), math.log(high))), low), high)
        if self.integer is not None:
            return int(rng.integers(self.integer[0], self.integer[1], endpoint=True))
        if self.normal is not None:
            return self.normal.draw(rng)
        assert self.choice is not None
        chosen: Value = self.choice[int(rng.integers(len(self.choice)))]
        return chosen

    def with_unit(self, value: Value) -> Value:
        """Return a drawn value with the unit that the file has for it, as a text; without a unit as it is."""
        if self._dimension is None or not isinstance(value, float):
            return value
        return f"{value!r} {si_unit(self._dimension)}"


def _dimension(given: Any) -> str | None:
    """Return the dimension of the numbers of a valid distribution; None if they have no units."""
    ends = [given.get("uniform"), given.get("log_uniform"), (given.get("normal") or {}).values()]
    found = {quantity(one).dimension for numbers in ends for one in numbers or ()} - {None}
    if len(found) > 1:
        raise ValueError(f"units of {' and '.join(sorted(map(str, found)))}; expected units of one kind")
    return next(iter(found), None)


def seed_of(seed: int, key: str) -> int:
    """Return a seed of 64 bits for one key of a trial."""
    return int(_sequence(seed, key).generate_state(1, np.uint64)[0])


def generator(seed: int, key: str) -> np.random.Generator:
    """Return the random numbers of one key of a trial."""
    return np.random.default_rng(_sequence(seed, key))


def _sequence(seed: int, key: str) -> np.random.SeedSequence:
    digest = hashlib.sha256(key.encode()).digest()
    words = [int.from_bytes(digest[at : at + 4], "little") for at in range(0, 32, 4)]
    return np.random.SeedSequence(seed, spawn_key=words)
