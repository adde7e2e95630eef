"""Hypothesis strategies for every message, from the models' annotations."""

import string
import typing
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from hypothesis import strategies as st
from pydantic import BaseModel, StringConstraints
from pydantic.fields import FieldInfo

from armgate.protocol.messages import CLIENT_MESSAGES, SERVER_MESSAGES

BIGGEST = 3
"""Largest generated collection; other tests cover the bounds."""

PATTERNS = {
    "^[A-Za-z0-9_.:/-]{1,64}$": st.text(
        string.ascii_letters + string.digits + "_.:/-", min_size=1, max_size=12
    )
    | st.just("x" * 64),
    "^[0-9a-f]{64}$": st.binary(min_size=32, max_size=32).map(bytes.hex),
}
"""Strategies by pattern, much faster than ``st.from_regex``."""


def of_model(model: type[BaseModel]) -> st.SearchStrategy[Any]:
    """Return a strategy for a model: required fields always, other fields sometimes."""
    hints = typing.get_type_hints(model, include_extras=True)
    fields = {name: of_type(hints[name]) for name in model.model_fields if name != "type"}
    needed = {name: s for name, s in fields.items() if model.model_fields[name].is_required()}
    others = {name: s for name, s in fields.items() if name not in needed}
    return st.fixed_dictionaries(needed, optional=others).map(lambda given: model(**given))


def of_type(kind: Any) -> st.SearchStrategy[Any]:
    """Return a strategy for an annotation."""
    if get_origin(kind) is Annotated:
        return of_annotated(*get_args(kind))
    if get_origin(kind) in (Union, UnionType):
        return st.one_of(*(st.none() if arm is NoneType else of_type(arm) for arm in get_args(kind)))
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if get_origin(kind) is tuple:
        return of_tuple(get_args(kind), 0, BIGGEST)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return st.deferred(lambda: of_model(kind))
    return {bool: st.booleans(), float: st.floats(), int: st.integers(0, 2**63 - 1), bytes: st.binary()}[kind]


def of_annotated(kind: Any, *notes: Any) -> st.SearchStrategy[Any]:
    """Return a strategy for an annotation with constraints."""
    flat = [part for note in notes for part in (note.metadata if isinstance(note, FieldInfo) else [note])]
    known = {type(part): part for part in flat}
    if text := known.get(StringConstraints):
        if text.pattern:
            return PATTERNS[text.pattern]
        return st.text(min_size=text.min_length or 0, max_size=40)
    at_least = known[MinLen].min_length if MinLen in known else 0
    if get_origin(kind) is tuple:
        at_most = min(BIGGEST, known[MaxLen].max_length) if MaxLen in known else BIGGEST
        return of_tuple(get_args(kind), at_least, at_most)
    if get_origin(kind) is dict:
        key, value = get_args(kind)
        return st.dictionaries(of_type(key), of_type(value), max_size=BIGGEST)
    if get_origin(kind) in (Union, UnionType):
        return of_type(kind)
    if kind is bytes:
        return st.binary(max_size=min(64, known[MaxLen].max_length))
    return of_number(kind, known)


def of_tuple(items: tuple[Any, ...], at_least: int, at_most: int) -> st.SearchStrategy[Any]:
    """Return a strategy for tuples of one kind of item, or of a fixed length."""
    if items[-1] is Ellipsis:
        return st.lists(of_type(items[0]), min_size=at_least, max_size=at_most).map(tuple)
    return st.tuples(*map(of_type, items))


def of_number(kind: type, known: dict[type, Any]) -> st.SearchStrategy[Any]:
    """Return a strategy for numbers within bounds; floats with constraints are finite."""
    low = known[Ge].ge if Ge in known else known[Gt].gt if Gt in known else None
    high = known[Le].le if Le in known else known[Lt].lt if Lt in known else None
    if kind is int:
        return st.integers(low, high - (Lt in known))
    return st.floats(low, high, exclude_min=Gt in known, allow_nan=False, allow_infinity=False)


FROM_CLIENT = {model: of_model(model) for model in CLIENT_MESSAGES}
FROM_SERVER = {model: of_model(model) for model in SERVER_MESSAGES}
