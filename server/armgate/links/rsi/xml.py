"""Reader of XML from a network or a file: UTF-8 only, without document types and entities."""

import re
import xml.etree.ElementTree as ET

_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


class XmlError(Exception):
    """Text that this reader does not accept; the message names the reason."""


def read_xml(data: bytes, limit: int, *, comments: bool = False) -> ET.Element:
    """Return the outermost element.

    The bytes are decoded first, and only then searched for declarations and parsed: no encoding can hide a
    declaration from the search. Document types, entities and CDATA begin with ``<!``, which a text
    without comments holds nowhere else.

    Args:
        data: The text; a declared encoding is ignored.
        limit: Longest text, bytes.
        comments: True to allow comments: files have them, telegrams do not.

    Raises:
        XmlError: The text is too long, not UTF-8, malformed, or has a declaration.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    text = _decoded(data)
    if "<!" in (_without_comments(text) if comments else text):
        allowed = "" if comments else ", nor are comments"
        raise XmlError(f"<!DOCTYPE, <!ENTITY and <![CDATA[ are not allowed{allowed}; remove them")
    try:
        return ET.fromstring(text)  # noqa: S314  (declarations are refused above)
    except (ET.ParseError, ValueError) as error:
        raise XmlError(f"not well-formed XML: {error}") from error


def _decoded(data: bytes) -> str:
    if data[:2] in _UTF16 or b"\0" in data:
        raise XmlError("the text is not UTF-8: it has NUL bytes or the mark of UTF-16; expected UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise XmlError(
            f"the text is not UTF-8: byte {error.start} is 0x{data[error.start]:02x}, as in Latin-1 or "
            f"Windows-1252; expected UTF-8"
        ) from error


def _without_comments(text: str) -> str:
    for found in _COMMENT.finditer(text):
        if "--" in found[1] or found[1].endswith("-"):
            line = text.count("\n", 0, found.start()) + 1
            raise XmlError(f"line {line}: a comment holds '--', which XML does not allow; remove the dashes")
    return _COMMENT.sub("", text)
