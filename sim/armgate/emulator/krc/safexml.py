"""Reader of XML from strangers: it has to be short, UTF-8, well-formed and free of declarations."""

import xml.etree.ElementTree as ET


class XmlError(Exception):
    """A text that is no XML for a KRC; says why."""


def read_xml(data: bytes, limit: int) -> ET.Element:
    """Return the outermost element.

    The bytes are decoded here and handed on as text, so that no declared encoding can hide a document type.

    Raises:
        XmlError: Longer than ``limit`` bytes, not UTF-8, with a document type or entities, or malformed.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    if data.startswith((b"\xfe\xff", b"\xff\xfe")):
        raise XmlError("byte 0 is not UTF-8 but the mark of UTF-16; save it as UTF-8")
    if 0 in data:
        raise XmlError(f"not well-formed XML: byte {data.index(0)} is NUL, as in UTF-16; save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        value = error.object[error.start]
        raise XmlError(
            f"byte {error.start} (0x{value:02x}) is not UTF-8, but perhaps Latin-1 or Windows-1252; "
            "save it as UTF-8"
        ) from error
    _refuse_declarations(text)
    try:
        return ET.fromstring(text)  # noqa: S314  (document types and entities are refused above)
    except (ET.ParseError, ValueError) as error:
        raise XmlError(f"not well-formed XML: {error}") from error


def _refuse_declarations(text: str) -> None:
    """Go through everything that begins with ``<!``: only well-formed comments may."""
    at = text.find("<!")
    while at >= 0:
        if not text.startswith("<!--", at):
            raise XmlError("document types, entities and CDATA are not allowed; remove <!DOCTYPE …>")
        dashes = text.find("--", at + 4)
        if dashes < 0:
            raise XmlError("a comment does not end; expected -->")
        if not text.startswith("-->", dashes):
            line = 1 + text[:dashes].count("\n")
            raise XmlError(f"a comment holds '--' in line {line}, which XML does not allow; remove it")
        at = text.find("<!", dashes + 3)
