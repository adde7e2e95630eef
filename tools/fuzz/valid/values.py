"""Random values of the messages' annotations, including their bounds."""

import string
import typing
from collections.abc import Callable
from functools import cache
from random import Random
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import StringConstraints
from pydantic.fields import FieldInfo

from armgate.protocol import messages as m

Make = Callable[[Random], Any]

_NAME = string.ascii_letters + string.digits + "_.:/-"
_FLOATS = (0.0, -0.0, 1.0, -1.0, 5e-324, -5e-324, 1e-9, 0.5, 1e308, -1e308, 1.7976931348623157e308)
_BEYOND = (float("nan"), float("inf"), float("-inf"))
_TEXTS = ("", "a", "x" * 512, "é" * 512, "漢🤖", "\x00\n\x1b[31m", "token", "a" * 511 + "\U0010ffff")


@cache
def fields_of(model: type[m.Message]) -> dict[str, Make]:
    """Return a generator of random values for each field of a message."""
    hints = typing.get_type_hints(model, include_extras=True)
    return {name: of(hints[name]) for name in model.model_fields if name != "type"}


def of(kind: Any) -> Make:
    """Return a generator of random values for an annotation.

    Raises:
        KeyError: No message of a client has a field of this kind yet; add it here.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _constrained(arguments[0], arguments[1:])
    if origin in (Union, UnionType):
        arms = [(lambda rng: None) if arm is NoneType else of(arm) for arm in arguments]
        return lambda rng: rng.choice(arms)(rng)
    if origin is Literal:
        return lambda rng: rng.choice(arguments)
    if kind is bool:
        return lambda rng: rng.random() < 0.5
    if kind is float:
        return lambda rng: rng.choice(_BEYOND) if rng.random() < 0.2 else _number(rng)
    raise KeyError(kind)


def _constrained(kind: Any, notes: tuple[Any, ...]) -> Make:
    flat = [part for note in notes for part in (note.metadata if isinstance(note, FieldInfo) else [note])]
    known = {type(part): part for part in flat}
    if (text := known.get(StringConstraints)) is not None:
        return _hash if text.pattern and "64}$" in text.pattern and "0-9a-f]" in text.pattern else _text(text)
    if get_origin(kind) is tuple:
        item, low = of(get_args(kind)[0]), known[MinLen].min_length if MinLen in known else 0
        high = known[MaxLen].max_length
        return lambda rng: tuple(item(rng) for _ in range(_length(rng, low, high)))
    if kind is int:
        low = known[Ge].ge
        return lambda rng: _whole(rng, low, known[Le].le if Le in known else known[Lt].lt - 1)
    if kind is float:
        return _share if Gt in known else _number
    return of(kind)


def _length(rng: Random, low: int, high: int) -> int:
    return rng.choice((low, high)) if rng.random() < 0.1 else rng.randint(low, min(high, low + 4))


def _whole(rng: Random, low: int, high: int) -> int:
    roll = rng.random()
    if roll < 0.3:
        return rng.choice((low, high))
    return rng.randint(low, min(high, low + 20)) if roll < 0.8 else rng.randint(low, high)


def _number(rng: Random) -> float | int:
    roll = rng.random()
    if roll < 0.3:
        return rng.choice(_FLOATS)
    return rng.randint(-(2**63), 2**64 - 1) if roll < 0.35 else rng.uniform(-10.0, 10.0)


def _share(rng: Random) -> float:
    return rng.choice((1.0, 5e-324, 1e-6, rng.uniform(0.01, 1.0)))


def _hash(rng: Random) -> str:
    return rng.randbytes(32).hex()


def _text(bounds: StringConstraints) -> Make:
    if bounds.pattern is not None:
        return lambda rng: "".join(rng.choices(_NAME, k=rng.choice((1, 3, 64))))
    if bounds.min_length:
        return lambda rng: "t" * rng.choice((1, 256))
    return lambda rng: rng.choice(_TEXTS) if rng.random() < 0.5 else f"reason {rng.randrange(30)}"
