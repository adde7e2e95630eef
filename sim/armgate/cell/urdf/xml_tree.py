"""XML of robot descriptions: elements with their line number; document types are refused.

Namespaces are not resolved: ``drake:acceleration`` stays a name with a prefix, declared or not, so that the
reader can refuse it by this name.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import NoReturn
from xml.parsers import expat

from armgate.cell.errors import ModelError

MAX_BYTES = 32 * 1024 * 1024
_MAX_DEPTH = 64


class Element(ET.Element):
    """Element of a file.

    Attributes:
        line: Line of its first character, counted from 1.
    """

    line: int


def line_prefix(element: ET.Element) -> str:
    """Return ``line 12: `` for an element of a file, and an empty text for an element added later."""
    line = getattr(element, "line", None)
    return "" if line is None else f"line {line}: "


def parse_xml(text: str) -> ET.Element:
    """Return the ``<robot>`` element of a URDF text.

    Raises:
        ModelError: The text is not XML, has a document type (entities could grow without bound), or has no
            ``<robot>``.
    """
    if len(text) > MAX_BYTES:
        raise ModelError(f"{len(text)} characters; expected at most {MAX_BYTES}")
    if "\0" in text:  # expat would read the text as UTF-16
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ModelError(f"line {line}: NUL, as in UTF-16; expected UTF-8: save the file as UTF-8")
    builder = _Builder()
    try:
        root = builder.build(text)
    except expat.ExpatError as error:
        raise ModelError(f"not well-formed XML: {error}") from error
    except UnicodeEncodeError as error:
        raise ModelError("not well-formed XML: a character that UTF-8 cannot encode") from error
    if root.tag != "robot":
        raise ModelError(f"the outer element is <{root.tag}>; expected <robot>")
    return root


def decode(data: bytes) -> str:
    """Return the text of a URDF file, which must be UTF-8 regardless of the encoding that it declares.

    Raises:
        ModelError: It has another encoding; the text gives the line.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ModelError(f"line {line}: not UTF-8; expected UTF-8: save the file as UTF-8") from error


class _Builder:
    """Builder of the element tree of one text."""

    def __init__(self) -> None:
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._tree = ET.TreeBuilder(element_factory=Element)
        self._depth = 0
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._tree.data
        self._parser.StartDoctypeDeclHandler = self._refuse_doctype

    def build(self, text: str) -> ET.Element:
        self._parser.Parse(text, True)
        return self._tree.close()

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ModelError(
                f"line {self._parser.CurrentLineNumber}: elements nested deeper than {_MAX_DEPTH}"
            )
        element = self._tree.start(tag, dict(attributes))
        assert isinstance(element, Element)
        element.line = self._parser.CurrentLineNumber

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self._tree.end(tag)

    def _refuse_doctype(self, *_: object) -> NoReturn:
        raise ModelError("a document type or entities are not allowed in a URDF; remove <!DOCTYPE …>")
