"""YAML files of a configuration, read and overlaid by the rules of docs/configuration.md.

The result is plain data, except that paths of files are ``Located``: a relative path refers to the folder of
the file that contains it.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from armgate.monitor.errors import DescriptionError
from armgate.monitor.files import Located, read_bytes

MAX_BYTES = 4 << 20
MAX_VALUES = 100_000
MAX_DEPTH = 32

_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_EMPTY = object()
"""Value of a node without any text, even ``null``; it leaves a mapping of an earlier file unchanged."""

_WORDS: dict[str, object] = {
    "": _EMPTY, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_FILE_KEYS = {"urdf", "file"}


def read_files(paths: Sequence[Path], *, confined: bool = False) -> dict[str, Any]:
    """Read configuration files; later ones overlay earlier ones.

    Args:
        paths: The files.
        confined: True if they may refer only to files of their own folder.

    Raises:
        DescriptionError: A file cannot be read or is not a YAML mapping; the text names file and line.
    """
    if not paths:
        raise DescriptionError("no configuration file given; expected at least one YAML file")
    tree: dict[str, Any] = {}
    for path in paths:
        tree = _merged(tree, _Reader(path, confined).read())
    return {key: _settled(value) for key, value in tree.items()}


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Overlay one mapping on another; a mapping with another ``kind`` or any other value replaces it.

    An empty section keeps the mapping below.
    """
    result = dict(below)
    for key, value in above.items():
        old = result.get(key)
        if isinstance(old, dict) and value is _EMPTY:
            continue
        if isinstance(old, dict) and isinstance(value, dict) and _kind(value) in (None, _kind(old)):
            value = _merged(old, value)  # noqa: PLW2901
        result[key] = value
    return result


def _kind(mapping: dict[str, Any]) -> object:
    return _settled(mapping.get("kind"))


def _settled(value: Any) -> Any:
    """Return a value with None for empty nodes."""
    if isinstance(value, dict):
        return {key: _settled(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_settled(item) for item in value]
    return None if value is _EMPTY else value


class _Reader:
    """Reader of one file."""

    def __init__(self, path: Path, confined: bool) -> None:
        self._path, self._confined = path, confined
        self._left = MAX_VALUES

    def read(self) -> dict[str, Any]:
        """Return the file's mapping."""
        try:
            root = yaml.compose(self._text(), Loader=yaml.BaseLoader)
            value = self._value(root, "", "", 0) if root is not None else None
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = "" if mark is None else f":{mark.line + 1}"
            what = getattr(error, "problem", None) or "a character that YAML does not allow"
            raise DescriptionError(f"{self._path}{line}: not YAML: {what}") from error
        except RecursionError as error:
            raise DescriptionError(f"{self._path}: nested too deeply") from error
        if not isinstance(value, dict):
            raise DescriptionError(f"{self._path}: expected a mapping that begins with 'armgate: 1'")
        return value

    def _text(self) -> str:
        data = read_bytes(self._path, MAX_BYTES, "")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise DescriptionError(f"{self._path}: not UTF-8") from error

    def _value(self, node: yaml.Node, key: str, around: str, depth: int) -> Any:
        self._left -= 1
        if self._left < 0 or depth > MAX_DEPTH:
            self._reject(node, f"more than {MAX_VALUES} values, or nested deeper than {MAX_DEPTH}")
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, key, depth)
        if isinstance(node, yaml.SequenceNode):
            return [self._value(item, "", key, depth + 1) for item in node.value]
        value = _scalar(node)
        names_file = key in _FILE_KEYS or around == "packages"
        if names_file and isinstance(value, str):
            return Located(value, self._path.parent, self._confined)
        return value

    def _mapping(self, node: yaml.MappingNode, key: str, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, value in node.value:
            if not isinstance(name, yaml.ScalarNode):
                self._reject(name, "a key that is not a text")
            if name.value in found:
                self._reject(name, f"the key {name.value!r} occurs twice")
            found[name.value] = self._value(value, name.value, key, depth + 1)
        return found

    def _reject(self, node: yaml.Node, what: str) -> None:
        raise DescriptionError(f"{self._path}:{node.start_mark.line + 1}: {what}")


def _scalar(node: yaml.Node) -> object:
    """Return the value of a scalar by the core schema of YAML 1.2; a quoted scalar is a text."""
    text = str(node.value)
    if getattr(node, "style", None) is not None:
        return text
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        return int(text) if len(text) < 400 else float("inf")
    return float(text) if _FLOAT.fullmatch(text) else text
