"""YAML files as one tree that keeps the file and line of every value for error messages.

Later files overlay earlier ones: mappings are merged key by key. All other values are replaced, including
lists and mappings with another ``kind``. Scalars follow YAML 1.2's core schema: ``1e-4`` is a number, and
``on`` is a text.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from armgate.cell.errors import ConfigError, ModelError
from armgate.cell.regular_file import read_file

Scalar = None | bool | int | float | str
KeyPath = tuple[str | int, ...]
"""Keys and indices that lead to a value."""

MAX_BYTES = 4 * 1024 * 1024
MAX_NODES = 100_000
_MAX_DIGITS = 40


@dataclass(frozen=True)
class Mark:
    """Place in a file; lines count from 1."""

    file: Path
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True)
class Node:
    """Value of the tree (a mapping, a sequence or a scalar) with its place and the places of its keys.

    ``empty`` is True if the file has no text at all for the value, not even ``null``.
    """

    value: "dict[str, Node] | tuple[Node, ...] | Scalar"
    mark: Mark
    keys: dict[str, Mark] = field(default_factory=dict)
    empty: bool = False

    def plain(self) -> object:
        """Return the value without marks; sequences become tuples."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        if isinstance(self.value, tuple):
            return tuple(node.plain() for node in self.value)
        return self.value

    def locate(self, path: KeyPath) -> Mark:
        """Return the place of the value under these keys and indices, or of the innermost one around it."""
        mark, node = self.mark, self
        for step in path:
            if isinstance(node.value, dict) and isinstance(step, str) and step in node.value:
                mark, node = node.keys[step], node.value[step]
            elif isinstance(node.value, tuple) and isinstance(step, int) and 0 <= step < len(node.value):
                node = node.value[step]
                mark = node.mark
            # Any other step was added by a validator: the value is at this node or further inside.
        return mark

    def replaced(self, path: KeyPath, value: "Node") -> "Node":
        """Return a tree with another value under these keys and indices; absent mappings are added.

        Raises:
            ConfigError: A value on the way is neither a mapping nor a list with this index; the error is at
                the mark of ``value``.
        """
        return self._replaced(path, value, ())

    def _replaced(self, path: KeyPath, value: "Node", above: KeyPath) -> "Node":
        if not path:
            return value
        step, rest, here = path[0], path[1:], (*above, path[0])
        if isinstance(self.value, dict) or self.empty:
            entries = self.value if isinstance(self.value, dict) else {}
            child = entries.get(str(step), Node({}, value.mark))
            changed = entries | {str(step): child._replaced(rest, value, here)}
            return Node(changed, self.mark, {str(step): value.mark} | self.keys)
        if isinstance(self.value, tuple) and isinstance(step, int) and 0 <= step < len(self.value):
            parts = list(self.value)
            parts[step] = parts[step]._replaced(rest, value, here)
            return Node(tuple(parts), self.mark, self.keys)
        raise config_error(value.mark, here, _no_place(self, step))


def _no_place(node: Node, step: str | int) -> str:
    if isinstance(node.value, tuple):
        return f"the list has no entry {step!r}; expected a number from 0 to {len(node.value) - 1}"
    return f"the key is inside of the value {node.value!r}; expected the key of a mapping or list"


def dotted(path: KeyPath) -> str:
    """Return keys and indices in the form of error messages: ``robots.FR.start.2``."""
    return ".".join(str(step) for step in path)


def config_error(mark: Mark | None, path: KeyPath, text: str) -> ConfigError:
    """Return a ``ConfigError`` about the value under ``path``, at ``mark`` (None: not in a file)."""
    where = ": ".join(part for part in ("" if mark is None else str(mark), dotted(path)) if part)
    file, line = (None, None) if mark is None else (mark.file, mark.line)
    return ConfigError(f"{where}: {text}" if where else text, file, line, dotted(path))


def read_tree(paths: Sequence[Path]) -> Node:
    """Read the files and overlay them in order.

    Raises:
        ConfigError: No file is given, a file cannot be read, is not a YAML mapping, or repeats a key.
    """
    if not paths:
        raise ConfigError("no configuration file given; expected at least one YAML file")
    tree = _read_file(Path(paths[0]))
    for path in paths[1:]:
        tree = _overlay(tree, _read_file(Path(path)))
    return tree


def _overlay(below: Node, above: Node) -> Node:
    if above.empty and isinstance(below.value, dict):
        return below  # an empty section neither adds nor removes anything
    if not (isinstance(below.value, dict) and isinstance(above.value, dict)):
        return above
    if _kind(above) not in (None, _kind(below)):
        return above
    merged = dict(below.value)
    for key, node in above.value.items():
        merged[key] = _overlay(merged[key], node) if key in merged else node
    return Node(merged, below.mark, below.keys | above.keys)


def _kind(node: Node) -> object:
    kind = node.value.get("kind") if isinstance(node.value, dict) else None
    return None if kind is None else kind.value


def _read_file(path: Path) -> Node:
    root = _compose(path, _read_text(path))
    if root is None:
        raise config_error(
            Mark(path, 1), (), "the file is empty; expected a mapping that begins with 'armgate: 1'"
        )
    if not isinstance(root, yaml.MappingNode):
        what = "not a mapping; expected 'key: value' lines that begin with 'armgate: 1'"
        raise config_error(Mark(path, 1), (), what)
    return _Converter(path).convert(root, (), ())


def _compose(path: Path, text: str) -> yaml.Node | None:
    try:
        return yaml.compose(text, Loader=_CoreLoader)
    except yaml.MarkedYAMLError as error:
        raise _yaml_error(path, error) from error
    except yaml.reader.ReaderError as error:
        mark = Mark(path, text.count("\n", 0, error.position) + 1)
        what = f"the character {chr(error.character)!r} is not allowed; remove it"
        raise config_error(mark, (), what) from error
    except RecursionError as error:
        raise config_error(Mark(path, 1), (), "nested too deeply; expected a flatter file") from error


def _read_text(path: Path) -> str:
    try:
        data = read_file(path, MAX_BYTES)
    except ModelError as error:
        raise ConfigError(f"{path}: {error}", path) from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        mark = Mark(path, data.count(b"\n", 0, error.start) + 1)
        raise config_error(mark, (), "not UTF-8; expected the file to be saved as UTF-8") from error


def _yaml_error(path: Path, error: yaml.MarkedYAMLError) -> ConfigError:
    mark = error.problem_mark or error.context_mark
    line = 1 if mark is None else mark.line + 1
    what = ", ".join(part for part in (error.context, error.problem) if part)
    return config_error(Mark(path, line), (), f"not YAML: {what}")


class _Converter:
    """Converter of the nodes of one file; bounds their number, because aliases can multiply them."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._count = 0

    def convert(self, node: yaml.Node, path: KeyPath, around: tuple[int, ...]) -> Node:
        self._check(node, path, around)
        around = (*around, id(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path, around)
        if isinstance(node, yaml.SequenceNode):
            parts = tuple(self.convert(part, (*path, i), around) for i, part in enumerate(node.value))
            return Node(parts, self._mark(node))
        return Node(
            self._scalar(node, path),
            self._mark(node),
            empty=node.value == "" and getattr(node, "style", None) is None,
        )

    def _check(self, node: yaml.Node, path: KeyPath, around: tuple[int, ...]) -> None:
        self._count += 1
        if self._count > MAX_NODES:
            raise self._error(
                node, path, f"more than {MAX_NODES} values; expected a smaller file or fewer aliases"
            )
        if id(node) in around:
            raise self._error(node, path, "the alias refers to a value that contains it; expected no loops")
        if not isinstance(node, yaml.ScalarNode) and node.tag not in _COLLECTIONS:
            raise self._unknown_tag(node, path)

    def _mapping(self, node: yaml.MappingNode, path: KeyPath, around: tuple[int, ...]) -> Node:
        values: dict[str, Node] = {}
        keys: dict[str, Mark] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise self._error(key_node, path, "a key is not a text; expected 'key: value'")
            key = self._text(key_node, path)
            if key in values:
                text = f"the key is repeated; expected it once (first in line {keys[key].line})"
                raise self._error(key_node, (*path, key), text)
            keys[key] = self._mark(key_node)
            values[key] = self.convert(value_node, (*path, key), around)
        return Node(values, self._mark(node), keys)

    def _scalar(self, node: yaml.Node, path: KeyPath) -> Scalar:
        text = self._text(node, path)
        if node.tag == _TAG + "str":
            return text
        forms = _FORMS.get(node.tag)
        if forms is None:
            raise self._unknown_tag(node, path)
        if not any(form.fullmatch(text) for form in forms):
            raise self._error(node, path, f"{text!r} does not fit its tag {node.tag!r}; remove the tag")
        if node.tag == _TAG + "int" and len(text) > _MAX_DIGITS:
            raise self._error(node, path, f"a number of {len(text)} digits; expected at most {_MAX_DIGITS}")
        return _VALUES[node.tag](text)

    def _text(self, node: yaml.Node, path: KeyPath) -> str:
        """Return the text of a scalar; names and messages can contain neither NUL nor lone surrogates."""
        text = str(node.value)
        bad = next((sign for sign in text if sign == "\0" or "\ud800" <= sign <= "\udfff"), None)
        if bad is not None:
            raise self._error(node, path, f"the character {bad!r} is not allowed; remove it")
        return text

    def _mark(self, node: yaml.Node) -> Mark:
        return Mark(self._path, node.start_mark.line + 1)

    def _unknown_tag(self, node: yaml.Node, path: KeyPath) -> ConfigError:
        return self._error(node, path, f"the tag {node.tag!r} is not known; expected plain values")

    def _error(self, node: yaml.Node, path: KeyPath, text: str) -> ConfigError:
        return config_error(self._mark(node), path, text)


# --- YAML 1.2's core schema -----------------------------------------------------------------------------


class _CoreLoader(yaml.SafeLoader):
    """Loader that resolves scalars by YAML 1.2's core schema instead of PyYAML's YAML 1.1."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}


_TAG = "tag:yaml.org,2002:"
_COLLECTIONS = (_TAG + "map", _TAG + "seq")

_FORMS: dict[str, list[re.Pattern[str]]] = {_TAG + "null": [re.compile("")]}
"""Forms of the scalars of each tag: values with explicit tags (``!!int abc``) must match them, too."""


def _resolve(tag: str, pattern: str, first: str) -> None:
    """Resolve plain scalars of this pattern, which begin with one of the characters ``first``, to a tag."""
    form = re.compile(pattern)
    _FORMS.setdefault(_TAG + tag, []).append(form)
    _CoreLoader.add_implicit_resolver(_TAG + tag, form, list(first))


_resolve("null", r"^(?:~|null|Null|NULL|)$", "~nN")
_CoreLoader.yaml_implicit_resolvers.setdefault("", []).append((_TAG + "null", re.compile("^$")))
_resolve("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF")
_resolve("int", r"^[-+]?[0-9]+$", "-+0123456789")
_resolve("float", r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$", "-+.0123456789")
_resolve("float", r"^(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$", "-+.")


_VALUES: dict[str, Callable[[str], Scalar]] = {
    _TAG + "null": lambda _: None,
    _TAG + "bool": lambda text: text.lower() == "true",
    _TAG + "int": int,
    _TAG + "float": lambda text: float(text.replace(".inf", "inf").replace(".nan", "nan")),
}
"""Conversion of a scalar's text, by tag."""
