"""XML from a network: read by expat as UTF-8, without declarations of any kind."""

import xml.etree.ElementTree as ET


class XmlError(Exception):
    """A text is no XML that is read here; says why."""


def read_xml(data: bytes, limit: int) -> ET.Element:
    """The outermost element.

    Document types and entities, whatever they would do, begin with ``<!``; so do comments, which no
    telegram of a KRC has. In UTF-8, which is read whatever the text declares, nothing can hide these
    two bytes.

    Args:
        data: The text.
        limit: At most so many bytes.

    Raises:
        XmlError: Too long, malformed, or with a declaration.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    if b"<!" in data:
        raise XmlError("a document type, an entity or a comment is not allowed")
    parser = ET.XMLParser(encoding="utf-8")  # noqa: S314  (declarations are refused above)
    try:
        parser.feed(data)
        return parser.close()
    except (ET.ParseError, ValueError) as error:
        raise XmlError(f"not well-formed XML: {error}") from error
