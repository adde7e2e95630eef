"""Header of PLY files: byte order, and the elements with their counts and properties."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.tokens import shown, whole

_TYPES = {
    b"char": "b", b"int8": "b", b"uchar": "B", b"uint8": "B", b"short": "h", b"int16": "h", b"ushort": "H",
    b"uint16": "H", b"int": "i", b"int32": "i", b"uint": "I", b"uint32": "I", b"float": "f", b"float32": "f",
    b"double": "d", b"float64": "d",
}  # fmt: skip
"""Types of properties, with their codes in ``struct``."""

_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
_IGNORED = (b"camera", b"material")
"""Elements that add no surface."""

FLOATS = "fd"
"""Codes of the types that are not whole numbers."""

BYTES = {kind: struct.calcsize("<" + kind) for kind in "bBhHiIfd"}
"""Sizes of the types by code."""


@dataclass(frozen=True)
class Property:
    """Column of an element.

    Attributes:
        name: Name of the property.
        kind: Code of its type.
        count: Code of the type of a list's length; None for a single value.
    """

    name: bytes
    kind: str
    count: str | None = None


@dataclass
class Element:
    """Element of the file: a table with a number of rows.

    Attributes:
        name: Name of the element.
        rows: Number of rows.
        columns: Columns, in order.
    """

    name: bytes
    rows: int
    columns: list[Property] = field(default_factory=list)

    def column(self, *names: bytes) -> int:
        """Return the index of the only column with one of these names.

        Raises:
            ModelError: There is none, or more than one.
        """
        found = [at for at, each in enumerate(self.columns) if each.name in names]
        if len(found) != 1:
            wanted = " or ".join(name.decode() for name in names)
            raise ModelError(
                f"the element {shown(self.name)} has {len(found)} properties called {wanted}; expected one"
            )
        return found[0]


def read_header(data: bytes) -> tuple[str, list[Element], int]:
    """Return the byte order ("" for text), the elements, and the index of the body's first byte.

    Raises:
        ModelError: The header is damaged, or declares something that is not supported.
    """
    order: str | None = None
    elements: list[Element] = []
    body = len(data)
    for line, words, end in _header_lines(data):
        if words[0] == b"format":
            order = _order(line, words)
        elif words[0] == b"element":
            elements.append(_element(line, words))
        elif words[0] == b"property":
            _add_property(line, words, elements)
        elif words[0] == b"end_header":
            body = end
        else:
            raise ModelError(
                f"line {line}: {shown(words[0])} in the header; expected format, element, property or "
                f"end_header"
            )
    if order is None:
        raise ModelError(f"the header has no 'format' line; expected one of {_known_orders()}")
    _check_elements(elements)
    return order, elements, body


def _header_lines(data: bytes) -> Iterator[tuple[int, list[bytes], int]]:
    """Yield number, words and end of each line up to ``end_header``, without comments."""
    ending = next((end for end in (b"\r\n", b"\n", b"\r") if data.startswith(b"ply" + end)), None)
    if ending is None:
        raise ModelError(f"line 1: begins with {shown(data[:8])}; expected 'ply' alone in the first line")
    start, line = 3 + len(ending), 2
    while (at := data.find(ending, start)) >= 0:
        text = data[start:at].strip()
        if b"\r" in text or b"\n" in text:
            raise ModelError(
                f"line {line}: a line end other than that of line 1; expected one kind in the header"
            )
        words = text.split()
        start = at + len(ending)
        if words and words[0] not in (b"comment", b"obj_info"):
            yield line, words, start
        if words[:1] == [b"end_header"]:
            return
        line += 1
    raise ModelError("the header has no 'end_header' line: the file is truncated; export it again")


def _order(line: int, words: list[bytes]) -> str:
    if len(words) != 3 or words[1] not in _ORDERS or words[2] != b"1.0":
        raise ModelError(
            f"line {line}: {shown(b' '.join(words))}; expected 'format KIND 1.0', KIND one of "
            f"{_known_orders()}"
        )
    return _ORDERS[words[1]]


def _known_orders() -> str:
    return ", ".join(order.decode() for order in _ORDERS)


def _element(line: int, words: list[bytes]) -> Element:
    if len(words) != 3:
        raise ModelError(f"line {line}: {shown(b' '.join(words))}; expected 'element NAME COUNT'")
    count = whole(words[2], line)
    if count < 0:
        raise ModelError(f"line {line}: {count} rows; expected 0 or more")
    return Element(words[1], count)


def _add_property(line: int, words: list[bytes], elements: list[Element]) -> None:
    kinds = words[2:4] if words[1:2] == [b"list"] else words[1:2]
    if not elements or len(words) != 3 + 2 * (len(kinds) == 2) or any(kind not in _TYPES for kind in kinds):
        raise ModelError(
            f"line {line}: {shown(b' '.join(words))}; expected 'property TYPE NAME' or 'property list TYPE "
            f"TYPE NAME' below an element, TYPE one of {', '.join(kind.decode() for kind in _TYPES)}"
        )
    names = [column.name for column in elements[-1].columns]
    if words[-1] in names:
        raise ModelError(
            f"line {line}: the property {shown(words[-1])} occurs twice; expected every name once"
        )
    *count, kind = (_TYPES[each] for each in kinds)
    if count and count[0] in FLOATS:
        raise ModelError(
            f"line {line}: a list with a length of type {kinds[0].decode()}; expected a type of whole numbers"
        )
    elements[-1].columns.append(Property(words[-1], kind, count[0] if count else None))


def _check_elements(elements: list[Element]) -> None:
    names = [element.name for element in elements]
    for element in elements:
        if names.count(element.name) > 1:
            raise ModelError(
                f"the element {shown(element.name)} occurs twice in the header; expected it once"
            )
        if element.name not in (b"vertex", b"face", *_IGNORED) and element.rows:
            raise ModelError(
                f"the element {shown(element.name)} is not supported; expected vertex and face: export "
                f"polygons"
            )
        if not element.columns and element.rows:
            raise ModelError(f"the element {shown(element.name)} has no property; expected at least one")
    for name in (b"vertex", b"face"):
        if name not in names:
            raise ModelError(f"the header has no element '{name.decode()}'; expected vertex and face")
