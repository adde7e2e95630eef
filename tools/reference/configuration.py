"""Reference of the configuration's keys, from its pydantic models."""

import inspect
import json
from collections.abc import Iterator
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel, BeforeValidator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from armgate.cell.config import CellConfig
from armgate.cell.config.link import LinkConfig
from armgate.cell.config.link_kinds import GROUP, load_kind
from armgate.cell.config.units import Quantity
from tools.reference.own import own_entry_points
from tools.reference.table import prose, table

HEAD = """\
# Configuration keys

<!-- Written by `make reference` from the code. -->

Every key that a cell's YAML files may hold, by section. [Configuration](configuration.md) explains how files
are written, read and overlaid.

- A number is in SI units: m, rad, s. "Number or text with unit" also accepts a text such as `50 mm`.
- An unknown key is an error.
- `NAME` stands for a name that the file chooses.
"""

Model = type[BaseModel]


def configuration() -> str:
    """Return the page."""
    sections = _sections()
    lines = [
        HEAD,
        *table(["section", ""], ([f"[{t}](#{_anchor(t)})", _first(m)] for m, t in sections.items())),
    ]
    for model, title in sections.items():
        lines += ["", f"## {title}", "", prose(inspect.getdoc(model) or ""), ""]
        lines += table(["key", "value", "default", ""], _rows(model, sections))
    return "\n".join(lines) + "\n"


def _first(model: Model) -> str:
    return prose(inspect.getdoc(model) or "").split("\n\n")[0].replace("\n", " ")


def _anchor(title: str) -> str:
    kept = "".join(c for c in title.lower() if c.isalnum() or c in "_- ")
    return kept.replace(" ", "-")


def _sections() -> dict[Model, str]:
    """Return every model of the configuration with its title, parents before their parts."""
    found: dict[Model, str] = {CellConfig: "Cell"}
    queue: list[tuple[Model, str]] = [(CellConfig, "")]
    while queue:
        model, path = queue.pop(0)
        for key, field in model.model_fields.items():
            for part, below in _models(field.annotation):
                if part in found:
                    continue
                place = f"{path}.{key}{below}".strip(".")
                kind = _kind(part)
                found[part] = place + (f", kind {kind}" if kind else "")
                queue.append((part, place))
    return found


def _models(annotation: Any, below: str = "") -> Iterator[tuple[Model, str]]:
    """Yield the models in a type, and the path from the field to each."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for model in _of_kinds(annotation):
            yield model, below
    elif get_origin(annotation) is dict:
        yield from _models(get_args(annotation)[1], f"{below}.NAME")
    elif get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _models(part, below)


def _of_kinds(model: Model) -> list[Model]:
    """Return the models of all kinds of armgate in place of the base of link sections."""
    if model is LinkConfig:
        return [load_kind(entry.name).config for entry in own_entry_points(GROUP)]
    return [model]


def _kind(model: Model) -> str:
    field = model.model_fields.get("kind")
    return "" if field is None else str(get_args(field.annotation)[0])


def _rows(model: Model, sections: dict[Model, str]) -> Iterator[tuple[str, str, str, str]]:
    for key, field in model.model_fields.items():
        value = _type(field.annotation, field.metadata, sections)
        yield f"`{key}`", value, _default(field, sections), " ".join(prose(field.description or "").split())


def _type(annotation: Any, notes: list[Any], sections: dict[Model, str]) -> str:
    """Return a type in words, with the bounds in its annotations."""
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inside[0], [*inside[1:], *notes], sections)
    if origin in {Union, UnionType}:
        parts = [_type(part, notes, sections) for part in inside if part is not NoneType]
        return " or ".join(dict.fromkeys(parts))
    if origin is tuple:
        return _list(inside, notes, sections)
    if origin is dict:
        return f"mapping of NAME to {_type(inside[1], [], sections)}{_size(notes)}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        titles = [sections[model] for model in _of_kinds(annotation)]
        return " or ".join(f"[{title}](#{_anchor(title)})" for title in titles)
    return _leaf(annotation, notes)


def _list(inside: tuple[Any, ...], notes: list[Any], sections: dict[Model, str]) -> str:
    if inside[-1] is ...:
        return f"list of {_type(inside[0], [], sections)}{_size(notes)}"
    parts = [_type(part, [], sections) for part in inside]
    if len(set(parts)) == 1:
        return f"list of {len(parts)}: {parts[0]} each"
    return f"list: {', '.join(parts)}"


def _leaf(annotation: Any, notes: list[Any]) -> str:
    if get_origin(annotation) is Literal:
        return " or ".join(f"`{each}`" for each in get_args(annotation))
    if annotation is Quantity:
        return "number or text with unit"
    names = {str: "text", bool: "`true` or `false`", int: "integer", float: "number"}
    with_unit = annotation is float and any(isinstance(note, BeforeValidator) for note in notes)
    return ("number or text with unit" if with_unit else names[annotation]) + _range(notes)


def _range(notes: list[Any]) -> str:
    """Return the strictest bounds of a number in words."""
    lows: list[tuple[Any, str]] = []
    highs: list[tuple[Any, str]] = []
    for bound in _flat(notes):
        match bound:
            case Gt():
                lows.append((bound.gt, "more than"))
            case Ge():
                lows.append((bound.ge, "at least"))
            case Lt():
                highs.append((bound.lt, "less than"))
            case Le():
                highs.append((bound.le, "at most"))
            case _:
                pass  # not a bound
    strictest = ([max(lows, key=_number)] if lows else []) + ([min(highs, key=_number)] if highs else [])
    return "".join(f", {word} {_shown(value)}" for value, word in strictest)


def _number(bound: tuple[Any, str]) -> float:
    return float(bound[0])


def _shown(number: Any) -> str:
    return f"{number:,.0f}" if abs(number) >= 1000 else f"{number:g}"


def _flat(notes: list[Any]) -> Iterator[Any]:
    for note in notes:
        yield from note.metadata if isinstance(note, FieldInfo) else (note,)


def _size(notes: list[Any]) -> str:
    least = max((note.min_length for note in _flat(notes) if isinstance(note, MinLen)), default=0)
    most = min((note.max_length for note in _flat(notes) if isinstance(note, MaxLen)), default=None)
    if most is None:
        return f", at least {least}" if least else ""
    return f", {least} to {most}"


def _default(field: FieldInfo, sections: dict[Model, str]) -> str:
    default = field.get_default(call_default_factory=True)
    if field.is_required() or default is PydanticUndefined:
        return "required"
    if isinstance(default, BaseModel):
        return "its defaults"
    if default is None or default in ((), {}):
        return "none"
    if isinstance(default, Enum):
        default = default.value
    if isinstance(default, float):
        return f"`{default:g}`"
    shown = list(default) if isinstance(default, tuple) else default
    return f"`{shown if isinstance(shown, str) else json.dumps(shown)}`"
