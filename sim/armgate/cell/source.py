"""YAML files as one tree that remembers file and line of every value, so that errors can name them.

Later files overlay earlier ones: where both hold a mapping the two are merged key by key, everything else
(lists too) is replaced, and so is a mapping that becomes one of another ``kind``. Scalars follow YAML 1.2's
core schema, so ``1e-4`` is a number and ``on`` a text.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from armgate.cell.errors import ConfigError, ModelError
from armgate.cell.plain_file import read_file

Scalar = None | bool | int | float | str
Path_ = tuple[str | int, ...]
MAX_BYTES = 4 * 1024 * 1024
MAX_NODES = 100_000
_DIGITS = 40


@dataclass(frozen=True)
class Mark:
    """A place in a file; lines count from 1."""

    file: Path
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True)
class Node:
    """A value of the tree (a mapping, a sequence or a scalar), where it stands, and where its keys do.

    ``empty`` is True if nothing at all stands there, not even ``null``.
    """

    value: "dict[str, Node] | tuple[Node, ...] | Scalar"
    mark: Mark
    keys: dict[str, Mark] = field(default_factory=dict)
    empty: bool = False

    def plain(self) -> object:
        """The value without marks; sequences are tuples."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        if isinstance(self.value, tuple):
            return tuple(node.plain() for node in self.value)
        return self.value

    def locate(self, path: Path_) -> Mark:
        """Where the value under these keys and indices stands, or else the innermost one around it."""
        mark, node = self.mark, self
        for step in path:
            if isinstance(node.value, dict) and isinstance(step, str) and step in node.value:
                mark, node = node.keys[step], node.value[step]
            elif isinstance(node.value, tuple) and isinstance(step, int) and 0 <= step < len(node.value):
                node = node.value[step]
                mark = node.mark
            # Anything else is a step that a validator added; the value is further in or right here.
        return mark


def read_tree(paths: Sequence[Path]) -> Node:
    """Reads the files and overlays them in order.

    Raises:
        ConfigError: No file is given, one cannot be read, or is not a YAML mapping with every key once.
    """
    if not paths:
        raise ConfigError("no configuration file given; expected at least one YAML file")
    tree = _read_file(Path(paths[0]))
    for path in paths[1:]:
        tree = _overlay(tree, _read_file(Path(path)))
    return tree


def _overlay(below: Node, above: Node) -> Node:
    if above.empty and isinstance(below.value, dict):
        return below  # a section in which nothing stands adds nothing, and takes nothing away
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
    text = _read_text(path)
    try:
        root = yaml.compose(text, Loader=_CoreLoader)
    except yaml.MarkedYAMLError as error:
        raise _yaml_error(path, error) from error
    except yaml.reader.ReaderError as error:
        mark = Mark(path, text.count("\n", 0, error.position) + 1)
        what = f"the character {chr(error.character)!r} is not allowed; remove it"
        raise finding(mark, (), what) from error
    except RecursionError as error:
        raise finding(Mark(path, 1), (), "nested too deeply; expected a flatter file") from error
    if root is None:
        raise finding(
            Mark(path, 1), (), "the file is empty; expected a mapping that begins with 'armgate: 1'"
        )
    if not isinstance(root, yaml.MappingNode):
        what = "not a mapping; expected 'key: value' lines that begin with 'armgate: 1'"
        raise finding(Mark(path, 1), (), what)
    return _Converter(path).convert(root, (), ())


def _read_text(path: Path) -> str:
    try:
        data = read_file(path, MAX_BYTES)
    except ModelError as error:
        raise ConfigError(f"{path}: {error}", path) from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        mark = Mark(path, data.count(b"\n", 0, error.start) + 1)
        raise finding(mark, (), "not UTF-8; expected the file to be saved as UTF-8") from error


def _yaml_error(path: Path, error: yaml.MarkedYAMLError) -> ConfigError:
    mark = error.problem_mark or error.context_mark
    line = 1 if mark is None else mark.line + 1
    what = ", ".join(part for part in (error.context, error.problem) if part)
    return finding(Mark(path, line), (), f"not YAML: {what}")


class _Converter:
    """Turns the nodes of one file into our tree, within a bounded number (aliases can multiply)."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._count = 0

    def convert(self, node: yaml.Node, path: Path_, around: tuple[int, ...]) -> Node:
        self._count += 1
        if self._count > MAX_NODES:
            raise self._error(
                node, path, f"more than {MAX_NODES} values; expected a smaller file or fewer aliases"
            )
        if id(node) in around:
            raise self._error(node, path, "the alias refers to a value that holds it; expected no loops")
        around = (*around, id(node))
        if not isinstance(node, yaml.ScalarNode) and node.tag not in _COLLECTIONS:
            raise self._error(node, path, f"the tag {node.tag!r} is not known; expected plain values")
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

    def _mapping(self, node: yaml.MappingNode, path: Path_, around: tuple[int, ...]) -> Node:
        values: dict[str, Node] = {}
        keys: dict[str, Mark] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise self._error(key_node, path, "a key that is no text; expected 'key: value'")
            key = self._text(key_node, path)
            if key in values:
                text = f"the key stands here again; expected it once (first in line {keys[key].line})"
                raise self._error(key_node, (*path, key), text)
            keys[key] = self._mark(key_node)
            values[key] = self.convert(value_node, (*path, key), around)
        return Node(values, self._mark(node), keys)

    def _scalar(self, node: yaml.Node, path: Path_) -> Scalar:
        text = self._text(node, path)
        if node.tag == "tag:yaml.org,2002:str":
            return text
        form = _FORMS.get(node.tag)
        if form is None:
            raise self._error(node, path, f"the tag {node.tag!r} is not known; expected plain values")
        if not any(one.fullmatch(text) for one in form):
            raise self._error(node, path, f"{text!r} is not of its tag {node.tag!r}; remove the tag")
        if node.tag == "tag:yaml.org,2002:null":
            return None
        if node.tag == "tag:yaml.org,2002:bool":
            return text.lower() == "true"
        if node.tag == "tag:yaml.org,2002:int":
            if len(text) > _DIGITS:
                raise self._error(node, path, f"a number of {len(text)} digits; expected at most {_DIGITS}")
            return int(text)
        return float(text.replace(".inf", "inf").replace(".nan", "nan"))

    def _text(self, node: yaml.Node, path: Path_) -> str:
        """Return the text of a scalar; no file, name or message can hold NUL or half a surrogate pair."""
        text = str(node.value)
        odd = next((sign for sign in text if sign == "\0" or "\ud800" <= sign <= "\udfff"), None)
        if odd is not None:
            raise self._error(node, path, f"the character {odd!r} is not allowed; remove it")
        return text

    def _mark(self, node: yaml.Node) -> Mark:
        return Mark(self._path, node.start_mark.line + 1)

    def _error(self, node: yaml.Node, path: Path_, text: str) -> ConfigError:
        return finding(self._mark(node), path, text)


class _CoreLoader(yaml.SafeLoader):
    """Resolves scalars by YAML 1.2's core schema instead of PyYAML's YAML 1.1."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


_FORMS: dict[str, list[re.Pattern[str]]] = {"tag:yaml.org,2002:null": [re.compile("")]}
"""Forms of the scalars of each tag: explicit tags (``!!int abc``) must fit, too."""

_COLLECTIONS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")


def _resolve(tag: str, pattern: str, first: str) -> None:
    form = re.compile(pattern)
    _FORMS.setdefault(f"tag:yaml.org,2002:{tag}", []).append(form)
    _CoreLoader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", form, list(first))


_resolve("null", r"^(?:~|null|Null|NULL|)$", "~nN")
_CoreLoader.yaml_implicit_resolvers.setdefault("", []).append(("tag:yaml.org,2002:null", re.compile("^$")))
_resolve("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF")
_resolve("int", r"^[-+]?[0-9]+$", "-+0123456789")
_resolve("float", r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$", "-+.0123456789")
_resolve("float", r"^(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$", "-+.")


def dotted(path: Path_) -> str:
    """Keys and indices as people write them: ``robots.FR.start.2``."""
    return ".".join(str(step) for step in path)


def finding(mark: Mark | None, path: Path_, text: str) -> ConfigError:
    """A ``ConfigError`` about the value under ``path``, which stands at ``mark`` (None: in no file)."""
    where = ": ".join(part for part in ("" if mark is None else str(mark), dotted(path)) if part)
    file, line = (None, None) if mark is None else (mark.file, mark.line)
    return ConfigError(f"{where}: {text}" if where else text, file, line, dotted(path))
