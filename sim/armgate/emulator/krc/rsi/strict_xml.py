"""Reader of untrusted XML: it must be short, UTF-8, well-formed and without declarations."""

import xml.etree.ElementTree as ET

from armgate.emulator.krc.errors import XmlError


def read_xml(data: bytes, limit: int) -> ET.Element:
    """Return the outermost element.

    The bytes are decoded here and parsed as text, so that no declared encoding can hide a document type.

    Raises:
        XmlError: The data have more than ``limit`` bytes, are not UTF-8, have a document type or entities, or
            are malformed.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    if data.startswith((b"\xfe\xff", b"\xff\xfe")):
        raise XmlError("byte 0 is the byte order mark of UTF-16; save it as UTF-8")
    if 0 in data:
        raise XmlError(f"not well-formed XML: byte {data.index(0)} is NUL, as in UTF-16; save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        value = error.object[error.start]
        raise XmlError(
            f"byte {error.start} (0x{value:02x}) is not UTF-8, perhaps Latin-1 or Windows-1252; "
            "save it as UTF-8"
        ) from error
    _refuse_declarations(text)
    try:
        return ET.fromstring(text)  # noqa: S314  (document types and entities are refused above)
    except (ET.ParseError, ValueError) as error:
        raise XmlError(f"not well-formed XML: {error}") from error


def _refuse_declarations(text: str) -> None:
    """Refuse everything that begins with ``<!``, except well-formed comments."""
    at = text.find("<!")
    while at >= 0:
        if not text.startswith("<!--", at):
            raise XmlError("document types, entities and CDATA are not allowed; remove <!DOCTYPE …>")
        dashes = text.find("--", at + 4)
        if dashes < 0:
            raise XmlError("a comment does not end; expected -->")
        if not text.startswith("-->", dashes):
            line = 1 + text[:dashes].count("\n")
            raise XmlError(f"a comment contains '--' in line {line}, which XML does not allow; remove it")
        at = text.find("<!", dashes + 3)
