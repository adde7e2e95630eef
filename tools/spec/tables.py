"""Generator of the tables and diagrams of SPEC.md, from the models, transition tables and error codes."""

import ast
import inspect
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel, StringConstraints
from pydantic.fields import FieldInfo

from armgate.protocol import CODES, Side, connection, lease
from armgate.protocol import ConnectionState as State
from armgate.protocol import messages as m

_FORMS: list[tuple[Any, str]] = [
    (m.Name, "name"),
    (m.Text, "text"),
    (m.Hash, "hash"),
    (m.Count, "count"),
    (m.Id, "id"),
    (m.Finite, "number"),
    (m.Share, "share"),
    (m.Joints, "joints"),
    (m.Increment, "joints, NaN and infinities included"),
    (m.Point, "point"),
    (m.Quaternion, "quaternion"),
]
_HEAD = ("field", "form", "default", "meaning")
_TYPES = {bool: "bool", int: "integer", float: "number", str: "text", bytes: "binary data"}


def client_messages() -> str:
    """Return the table of the client's messages."""
    return _messages(m.CLIENT_MESSAGES)


def server_messages() -> str:
    """Return the table of the server's messages."""
    return _messages(m.SERVER_MESSAGES)


def parts() -> str:
    """Return the table of the maps inside messages."""
    found = [x for x in vars(m).values() if isinstance(x, type) and issubclass(x, m.Part) and x is not m.Part]
    rows = [(f"**{part.__name__}**", "", "", "", _summary(part)) for part in found]
    return _table(("map", *_HEAD), _with_fields(rows, found))


def answers() -> str:
    """Return the table of requests and answers."""
    rows = [(f"`{_type(request)}`", f"`{_type(answer)}`") for request, answer in m.ANSWERS.items()]
    return _table(("request", "answer"), rows)


def error_codes() -> str:
    """Return the table of error codes."""
    rows = [
        (f"`{code}`", "yes" if info.fatal else "no", info.meaning, info.advice)
        for code, info in CODES.items()
    ]
    return _table(("code", "fatal", "means", "what to do"), rows)


def connection_machine() -> str:
    """Return the state machine of a connection, as a diagram and a table."""
    grouped: dict[tuple[State, Side, State], list[str]] = {}
    for (state, side, event), following in connection.TRANSITIONS.items():
        grouped.setdefault((state, side, following), []).append(event)
    order = list(State)
    keys = sorted(grouped, key=lambda k: (order.index(k[0]), k[1] is Side.SERVER, order.index(k[2])))
    rows, edges = [], []
    for key in keys:
        state, side, following = key
        sent = ", ".join(_events_in_words(grouped[key], side))
        client, server = (sent, "") if side is Side.CLIENT else ("", sent)
        rows.append((state.value, client, server, following.value))
        edges.append((state.value, following.value, f"{side.value}: {sent.replace('`', '')}"))
    return _diagram(edges, start=order[0].value, end=order[-1].value) + "\n\n" + _table(
        ("state", "the client sends", "the server sends", "next state"), rows
    )  # fmt: skip


def lease_machine() -> str:
    """Return the state machine of a lease, as a diagram and a table."""
    rows = [(a.value, event.value, b.value) for (a, event), b in lease.TRANSITIONS.items()]
    edges = [(a, b, event) for a, event, b in rows]
    return _diagram(edges, start=rows[0][0]) + "\n\n" + _table(("state", "event", "next state"), rows)


BLOCKS: dict[str, Callable[[], str]] = {
    "client": client_messages,
    "server": server_messages,
    "parts": parts,
    "answers": answers,
    "connection": connection_machine,
    "errors": error_codes,
    "lease": lease_machine,
}
"""Generators of the blocks between ``<!-- begin NAME -->`` and ``<!-- end -->``."""

_BLOCK = re.compile(r"(<!-- begin ([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """Return the text with every block generated anew.

    Raises:
        ValueError: The text has other blocks than ``blocks``, or one block twice.
    """
    names = [match[2] for match in _BLOCK.finditer(text)]
    if sorted(names) != sorted(blocks):
        raise ValueError(f"expected the blocks {sorted(blocks)}, each once; the text has {sorted(names)}")
    return _BLOCK.sub(lambda match: f"{match[1]}{blocks[match[2]]()}\n{match[3]}", text)


# --- messages ---------------------------------------------------------------------------------------------


def _messages(models: Sequence[type[m.Message]]) -> str:
    rows = [(f"**`{_type(model)}`**", "", "", "", _summary(model)) for model in models]
    return _table(("type", *_HEAD), _with_fields(rows, models))


def _with_fields(
    heads: Sequence[tuple[str, ...]], models: Sequence[type[BaseModel]]
) -> Iterable[tuple[str, ...]]:
    for head, model in zip(heads, models, strict=True):
        yield head
        hints = typing.get_type_hints(model, include_extras=True)
        for name, field in model.model_fields.items():
            if name != "type":
                yield "", f"`{name}`", form(hints[name]), _default(field), _meaning(model, name)


def _meaning(model: type[BaseModel], field: str) -> str:
    """Return the docstring of a field, from the model or the base that declares it."""
    for base in model.__mro__:
        if (text := _field_docstrings().get((base.__name__, field))) is not None:
            return text.removesuffix(".").replace("None", "nil")
    raise ValueError(f"{model.__name__}.{field} has no docstring; expected one in messages.py")


@cache
def _field_docstrings() -> dict[tuple[str, str], str]:
    found = {}
    for definition in ast.parse(inspect.getsource(m)).body:
        if isinstance(definition, ast.ClassDef):
            for field, text in pairwise(definition.body):
                match field, text:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                        value=ast.Constant(value=str(doc))
                    ):
                        found[definition.name, name] = doc
    return found


def _type(model: type[m.Message]) -> str:
    return str(model.model_fields["type"].default)


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split()).replace("``", "`")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ""
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "nil"
    if isinstance(value, str):
        return f"`{value}`" if value else "empty"
    if isinstance(value, (tuple, dict)):
        return "empty"
    return str(value).lower()


def form(kind: Any) -> str:
    """Return an annotation in words."""
    known = [name for alias, name in _FORMS if kind == alias]
    return known[0] if known else _unnamed(kind, get_origin(kind), get_args(kind))


def _unnamed(kind: Any, origin: Any, args: Sequence[Any]) -> str:
    if origin is Annotated:
        return _bounded(args[0], args[1:])
    if origin in (Union, types.UnionType):
        return " or ".join("nil" if arm is type(None) else form(arm) for arm in args)
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in args)
    if origin is tuple:
        return _array(args, "")
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.__name__
    return _TYPES[kind]


def _bounded(kind: Any, notes: Sequence[Any]) -> str:
    flat = [part for note in notes for part in (note.metadata if isinstance(note, FieldInfo) else [note])]
    bounds = {type(part): part for part in flat}
    length = _length(bounds)
    origin, args = get_origin(kind), get_args(kind)
    if origin is tuple:
        return _array(args, length)
    if origin is dict:
        return f"map of {length} × {form(args[0])} → {form(args[1])}"
    if kind is str:
        text: StringConstraints = bounds[StringConstraints]
        return f"text of {text.min_length or 0} to {text.max_length} characters"
    if kind is bytes:
        return f"{form(kind)}, {length} bytes"
    return f"{form(kind)} {_range(bounds)}"


def _array(args: Sequence[Any], length: str) -> str:
    if args[-1] is Ellipsis:
        return f"array of {length + ' × ' if length else ''}{form(args[0])}"
    return f"array of {', '.join(form(arg) for arg in args)}"


def _length(bounds: dict[type, Any]) -> str:
    least = bounds[MinLen].min_length if MinLen in bounds else 0
    most = bounds[MaxLen].max_length if MaxLen in bounds else None
    if most is None:
        return ""
    return f"{least} to {most}" if least else f"at most {most}"


def _range(bounds: dict[type, Any]) -> str:
    words = {Ge: ("from", "ge"), Gt: ("above", "gt"), Le: ("to", "le"), Lt: ("below", "lt")}
    return " ".join(
        f"{word} {getattr(bounds[kind], key):g}" if isinstance(getattr(bounds[kind], key), float)
        else f"{word} {getattr(bounds[kind], key)}"
        for kind, (word, key) in words.items() if kind in bounds
    )  # fmt: skip


# --- machines ---------------------------------------------------------------------------------------------


def _events_in_words(events: list[str], side: Side) -> Iterable[str]:
    models = m.CLIENT_MESSAGES if side is Side.CLIENT else m.SERVER_MESSAGES
    others = {_type(model) for model in models} - {"hello", "welcome", "bye"}
    left = list(events)
    if others <= set(left):
        left = [event for event in left if event not in others]
        yield "any other message"
    for event in left:
        yield "a fatal `error`" if event == "fatal" else f"`{event}`"


def _diagram(edges: Iterable[tuple[str, str, str]], start: str, end: str | None = None) -> str:
    merged: dict[tuple[str, str], list[str]] = {}
    for a, b, label in edges:
        merged.setdefault((a, b), []).append(label)
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {start}"]
    lines += [f"    {a} --> {b}: {' / '.join(labels)}" for (a, b), labels in merged.items()]
    lines += [f"    {end} --> [*]"] if end else []
    return "\n".join([*lines, "```"])


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
