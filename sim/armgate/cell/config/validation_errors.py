"""Conversion of pydantic's errors to sentences with file, line, key and expectation."""

import difflib
from collections.abc import Iterator
from typing import get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from armgate.cell.config.link import LinkConfig
from armgate.cell.config.link_kinds import load_kind
from armgate.cell.config.yaml_tree import KeyPath, Node, config_error
from armgate.cell.errors import ConfigError, join_lines
from armgate.cell.names import NAME_TEXT

_TEXTS = {
    "missing": "the key is missing; expected it here",
    "model_type": "{input} is not a mapping; expected 'key: value' lines",
    "model_attributes_type": "{input} is not a mapping; expected 'key: value' lines",
    "dict_type": "{input} is not a mapping; expected 'name: …' lines",
    "tuple_type": "{input} is not a list; expected [a, b, …]",
    "string_type": "{input} is not a text; expected a text",
    "int_type": "{input} is not a whole number; expected a whole number",
    "int_from_float": "{input} is not a whole number; expected a whole number",
    "float_type": "{input} is not a number; expected a number",
    "finite_number": "{input} is not finite; expected a finite number",
    "greater_than": "{input} is too small; expected more than {gt}",
    "greater_than_equal": "{input} is too small; expected at least {ge}",
    "less_than_equal": "{input} is too large; expected at most {le}",
    "literal_error": "{input} is not possible; expected {expected}",
    "union_tag_invalid": "kind {tag!r} is not possible; expected one of {expected_tags}",
    "union_tag_not_found": "the key 'kind' is missing; expected it here",
    "string_pattern_mismatch": "{input} is not a valid name; expected " + NAME_TEXT,
    "too_short": "{actual_length} entries; expected at least {min_length}",
    "too_long": "{actual_length} entries; expected at most {max_length}",
}


def to_config_error(error: ValidationError, tree: Node, model: type[BaseModel]) -> ConfigError:
    """Return one ``ConfigError`` for all errors, a line each; file, line and path are those of the first."""
    details = error.errors(include_url=False)
    paths = [_path(detail, tree) for detail in details]
    errors = [
        config_error(tree.locate(path), path, _text(detail, path, model, tree))
        for detail, path in zip(details, paths, strict=True)
    ]
    errors.sort(key=lambda each: (str(each.file), each.line))
    first = errors[0]
    return ConfigError(join_lines(map(str, errors)), first.file, first.line, first.path)


def _path(detail: ErrorDetails, tree: Node) -> KeyPath:
    """Return pydantic's location without the steps that it adds (validators, tags of unions)."""
    path: list[str | int] = []
    node: Node | None = tree
    for step in detail["loc"]:
        child = None if node is None else _child(node, step)
        if child is not None:
            path.append(step)
            node = child
    if detail["type"] == "missing":
        path.append(detail["loc"][-1])
    return tuple(path)


def _child(node: Node, step: str | int) -> Node | None:
    if isinstance(node.value, dict):
        return node.value.get(str(step))
    if isinstance(node.value, tuple) and isinstance(step, int) and 0 <= step < len(node.value):
        return node.value[step]
    return None


def _text(detail: ErrorDetails, path: KeyPath, model: type[BaseModel], tree: Node) -> str:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "value_error":
        return str(context["error"])
    if kind == "extra_forbidden":
        return _unknown_key(str(path[-1]), _known_keys(model, detail["loc"][:-1], tree))
    if kind == "missing" and isinstance(path[-1], int):
        return "an entry is missing; expected it here"
    if kind in _TEXTS:
        numbers = {
            key: _shown(value) if isinstance(value, float) else value for key, value in context.items()
        }
        if numbers.get("actual_length", 0) is None:  # pydantic stops counting the entries of a mapping
            numbers["actual_length"] = f"more than {numbers['max_length']}"
        return _TEXTS[kind].format(input=_shown(detail["input"]), **numbers)
    return f"{detail['msg']} (got {_shown(detail['input'])})"


def _shown(value: object) -> str:
    """Return a value as a file could contain it, shortened to 60 characters."""
    if value is None:
        return "an empty value"
    text = (
        f"{value:g}" if isinstance(value, float) else repr(list(value) if isinstance(value, tuple) else value)
    )
    return text if len(text) <= 60 else text[:57] + "..."


def _unknown_key(key: str, known: list[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"unknown key {key!r}; {hint}expected one of {', '.join(known)}"


def _known_keys(model: type[BaseModel], path: KeyPath, tree: Node) -> list[str]:
    """Return the keys of the models under this path, found by following it through the annotations."""
    front: list[object] = [model]
    node: Node | None = tree
    for step in path:
        front = [inner for outer in front for inner in _inside(outer, step)]
        node = None if node is None else _child(node, step)
        if node is not None and LinkConfig in front:
            kind = _child(node, "kind")  # it decides which model the section has
            front = [LinkConfig if kind is None else load_kind(str(kind.value)).config]
    return [key for inner in front for cls in _models(inner) for key in cls.model_fields]


def _inside(annotation: object, step: str | int) -> list[object]:
    for cls in _models(annotation):
        if "kind" in cls.model_fields and step in get_args(cls.model_fields["kind"].annotation):
            return [cls]  # the tag of a union of models
        field = cls.model_fields.get(str(step))
        if field is not None:
            return [field.annotation]
    # A mapping or list of models: the step is a name or an index in it, the models are its arguments.
    return [part for part in get_args(annotation) if list(_models(part))]


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    """Yield the models that this annotation may hold directly: itself, or the members of a union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif getattr(annotation, "__origin__", None) is None:
        for part in get_args(annotation):
            yield from _models(part)
