"""XML from a network: read by expat, without document types and entities, and only so deep."""

from collections.abc import Callable
from xml.parsers import expat

_DEEPEST = 8


class XmlError(Exception):
    """A text is no XML that is read here; says why."""


def read_xml(
    data: bytes,
    limit: int,
    start: Callable[[int, str, dict[str, str]], None],
    text: Callable[[int, str], None],
) -> None:
    """Reads a document.

    Args:
        data: Its bytes, UTF-8 whatever it declares.
        limit: At most so many.
        start: Told of each element as it opens: its depth, from 0, its name and attributes.
        text: Told of each piece of text, and the depth of the element that holds it.

    Raises:
        XmlError: Too long, too deep, malformed, or with a document type.
    """
    if len(data) > limit:
        raise XmlError(f"{len(data)} bytes; expected at most {limit}")
    parser = expat.ParserCreate("utf-8")
    depth = -1

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise XmlError(f"<{name[:40]}> is nested too deeply")
        start(depth, name, attributes)

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1

    def document_type(*_: object) -> None:
        raise XmlError("a document type or entities are not allowed")

    parser.buffer_text = True
    parser.StartElementHandler = opened
    parser.EndElementHandler = closed
    parser.CharacterDataHandler = lambda piece: text(depth, piece)
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise XmlError(f"not well-formed XML: {error}") from error
    except ValueError as error:  # what expat cannot decode
        raise XmlError(f"not XML: {error}") from error
