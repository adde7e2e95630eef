"""XML from strangers: refused unless it is short, well-formed and free of document types and entities."""

import xml.etree.ElementTree as ET


class XmlError(Exception):
    """A text is no XML that a KRC reads; says why."""


def read_xml(data: bytes, limit: int) -> ET.Element:
    """The outermost element.

    The bytes are decoded here and handed on as text, so that no declared encoding can hide a document type.

    Raises:
        XmlError: Longer than ``limit`` bytes, not UTF-8, with a document type or entities, or malformed.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise XmlError(f"byte {error.start} is not UTF-8") from error
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise XmlError("a document type or entities are not allowed; remove <!DOCTYPE …>")
    try:
        return ET.fromstring(text)  # noqa: S314  (document types and entities are refused above)
    except (ET.ParseError, ValueError) as error:
        raise XmlError(f"not well-formed XML: {error}") from error
