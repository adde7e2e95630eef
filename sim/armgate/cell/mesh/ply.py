"""Reader of PLY files: ascii, binary_little_endian and binary_big_endian.

The header announces elements (vertex, face, …) with their counts and properties; the body holds their rows,
element by element. All rows are read, whatever they hold, so that a wrong count cannot shift what follows.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.mesh.soup import Soup
from armgate.cell.mesh.text import lines_of, numbers, shown, whole

_TYPES = {
    b"char": "b", b"int8": "b", b"uchar": "B", b"uint8": "B", b"short": "h", b"int16": "h", b"ushort": "H",
    b"uint16": "H", b"int": "i", b"int32": "i", b"uint": "I", b"uint32": "I", b"float": "f", b"float32": "f",
    b"double": "d", b"float64": "d",
}  # fmt: skip
_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
_CORNERS = (b"vertex_indices", b"vertex_index")
_IGNORED = (b"camera", b"material")
"""Elements that add no surface."""

_AXES = (b"x", b"y", b"z")
_NEEDED = (*_AXES, *_CORNERS)
_FLOATS = "fd"
_BYTES = {kind: struct.calcsize("<" + kind) for kind in "bBhHiIfd"}

Row = list[Sequence[float]]


@dataclass(frozen=True)
class _Property:
    """A column; ``count`` is the type of a list's length, None for a single value."""

    name: bytes
    kind: str
    count: str | None = None


@dataclass
class _Element:
    name: bytes
    rows: int
    columns: list[_Property] = field(default_factory=list)

    def column(self, *names: bytes) -> int:
        """Return the place of the only column with one of these names.

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


def read_ply(data: bytes) -> Soup:
    """Read a PLY file.

    Raises:
        ModelError: The file is damaged, or holds something that is not supported; the text names the place.
    """
    order, elements, body = _header(data)
    _check_elements(elements)
    rows = _Text(data, body) if order == "" else _Binary(data, body, order)
    vertices = np.zeros((0, 3))
    faces = Soup.of(vertices, [], [], [])
    for element in elements:
        if element.name == b"vertex":
            vertices = _vertices(element, rows)
        elif element.name == b"face":
            faces = _faces(element, rows)
        else:
            for number in range(element.rows):
                rows.take(element, number)
    rows.finish()
    _check_corners(faces, len(vertices))
    return Soup(vertices, faces.corners, faces.sizes, faces.lines)


# --- the header ---------------------------------------------------------------------------------------------


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """Return the byte order ("" for text), the elements, and the first byte of the body."""
    order: str | None = None
    elements: list[_Element] = []
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
    return order, elements, body


def _header_lines(data: bytes) -> Iterator[tuple[int, list[bytes], int]]:
    """Yield number, words and end of each line up to ``end_header``; comments are left out."""
    ending = next((end for end in (b"\r\n", b"\n", b"\r") if data.startswith(b"ply" + end)), None)
    if ending is None:
        raise ModelError(f"line 1: begins with {shown(data[:8])}; expected 'ply' alone in the first line")
    start, line = 3 + len(ending), 2
    while (at := data.find(ending, start)) >= 0:
        text = data[start:at].strip()
        if b"\r" in text or b"\n" in text:
            raise ModelError(
                f"line {line}: another line end than that of line 1; expected the same in the header"
            )
        words = text.split()
        start = at + len(ending)
        if words and words[0] not in (b"comment", b"obj_info"):
            yield line, words, start
        if words[:1] == [b"end_header"]:
            return
        line += 1
    raise ModelError("the header has no 'end_header' line: the file is cut off; export it again")


def _order(line: int, words: list[bytes]) -> str:
    if len(words) != 3 or words[1] not in _ORDERS or words[2] != b"1.0":
        raise ModelError(
            f"line {line}: {shown(b' '.join(words))}; expected 'format KIND 1.0', KIND one of "
            f"{_known_orders()}"
        )
    return _ORDERS[words[1]]


def _known_orders() -> str:
    return ", ".join(order.decode() for order in _ORDERS)


def _element(line: int, words: list[bytes]) -> _Element:
    if len(words) != 3:
        raise ModelError(f"line {line}: {shown(b' '.join(words))}; expected 'element NAME COUNT'")
    count = whole(words[2], line)
    if count < 0:
        raise ModelError(f"line {line}: {count} rows; expected 0 or more")
    return _Element(words[1], count)


def _add_property(line: int, words: list[bytes], elements: list[_Element]) -> None:
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
    if count and count[0] in _FLOATS:
        raise ModelError(
            f"line {line}: a list with a length of type {kinds[0].decode()}; expected a whole type"
        )
    elements[-1].columns.append(_Property(words[-1], kind, count[0] if count else None))


def _check_elements(elements: list[_Element]) -> None:
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


# --- the rows -----------------------------------------------------------------------------------------------


class _Text:
    """Rows of an ascii body: one a line. Only the columns in ``_NEEDED`` must be finite."""

    def __init__(self, data: bytes, body: int) -> None:
        self._line = len(data[:body].splitlines())
        self._lines = iter(lines_of(data[body:]))

    def take(self, element: _Element, number: int) -> Row:
        """Return the values of the next row, column by column.

        Raises:
            ModelError: The file ends, or the row does not fit its element.
        """
        words = self._filled()
        if words is None:
            raise ModelError(_cut_off(element, number))
        row: Row = []
        for column in element.columns:
            size = 1
            if column.count is not None:
                size = whole(words.pop(0), self._line) if words else -1
            if not 0 <= size <= len(words):
                raise ModelError(
                    f"line {self._line}: too few values for the properties of {shown(element.name)}; "
                    f"expected {len(element.columns)} properties: export the file again"
                )
            values, words = words[:size], words[size:]
            row.append(self._read(values, column))
        if words:
            raise ModelError(
                f"line {self._line}: {shown(words[0])} follows the last property; expected the end of the "
                f"line"
            )
        return row

    def _read(self, words: list[bytes], column: _Property) -> Sequence[float]:
        if column.name not in _NEEDED:
            return self._any(words)
        if column.kind in _FLOATS:
            return numbers(words, self._line)
        return [whole(word, self._line) for word in words]

    def _any(self, words: list[bytes]) -> list[float]:
        """Read numbers of any kind: a normal need not be finite."""
        try:
            return [float(word) for word in words]
        except ValueError:
            text = f"line {self._line}: {shown(b' '.join(words))}; expected numbers: export the file again"
            raise ModelError(text) from None

    def _filled(self) -> list[bytes] | None:
        for text in self._lines:
            self._line += 1
            words = text.split()
            if words:
                return words
        return None

    def line(self) -> list[int]:
        """Return the line of the row that was taken last."""
        return [self._line]

    def finish(self) -> None:
        """Raise a ModelError if something follows the last row."""
        words = self._filled()
        if words is not None:
            raise ModelError(
                f"line {self._line}: {shown(words[0])} follows the last row; expected the end of the file: "
                f"the counts in its header are wrong"
            )


class _Binary:
    """Rows of a binary body."""

    def __init__(self, data: bytes, body: int, order: str) -> None:
        self._data, self._at, self._order = data, body, order

    def take(self, element: _Element, number: int) -> Row:
        """Return the values of the next row, column by column.

        Raises:
            ModelError: The file ends, or a list has a negative length.
        """
        row: Row = []
        for column in element.columns:
            size = 1
            if column.count is not None:
                size = int(self._unpack(column.count, 1, element, number)[0])
                if size < 0:
                    raise ModelError(f"byte {self._at}: a list of length {size}; expected 0 or more")
            row.append(self._unpack(column.kind, size, element, number))
        return row

    def _unpack(self, kind: str, size: int, element: _Element, number: int) -> Sequence[float]:
        form = f"{self._order}{size}{kind}"
        end = self._at + size * _BYTES[kind]
        if end > len(self._data):
            raise ModelError(_cut_off(element, number))
        values = struct.unpack_from(form, self._data, self._at)
        self._at = end
        return values

    def line(self) -> list[int]:
        """Return nothing: a binary file has no lines."""
        return []

    def finish(self) -> None:
        """Raise a ModelError if something follows the last row."""
        left = len(self._data) - self._at
        if left:
            raise ModelError(
                f"byte {self._at}: {left} bytes follow the last row; expected the end of the file: the "
                f"counts in its header are wrong"
            )


def _cut_off(element: _Element, number: int) -> str:
    return (
        f"the file ends after {number} of {element.rows} rows of the element {shown(element.name)}: it is "
        f"cut off, or the counts in its header are wrong; export it again"
    )


def _vertices(element: _Element, rows: _Text | _Binary) -> NDArray[np.float64]:
    places = [element.column(axis) for axis in _AXES]
    for place in places:
        if element.columns[place].count is not None:
            raise ModelError(
                f"the property {shown(element.columns[place].name)} is a list; expected one number"
            )
    flat: list[float] = []
    for number in range(element.rows):
        row = rows.take(element, number)
        values = [float(row[place][0]) for place in places]
        if not all(map(math.isfinite, values)):
            raise ModelError(f"vertex {number}: a coordinate is no finite number; export the file again")
        flat += values
    return np.array(flat, dtype=np.float64).reshape(-1, 3)


def _faces(element: _Element, rows: _Text | _Binary) -> Soup:
    place = element.column(*_CORNERS)
    column = element.columns[place]
    if column.count is None or column.kind in _FLOATS:
        raise ModelError(f"the property {shown(column.name)} is no list of whole numbers; expected one")
    corners: list[int] = []
    sizes: list[int] = []
    lines: list[int] = []
    for number in range(element.rows):
        face = rows.take(element, number)[place]
        if len(face) < 3:
            raise ModelError(f"face {number + 1}: {len(face)} corners; expected at least 3")
        corners += map(int, face)
        sizes.append(len(face))
        lines += rows.line()
    return Soup.of(np.zeros((0, 3)), corners, sizes, lines)


def _check_corners(faces: Soup, count: int) -> None:
    wrong = np.flatnonzero((faces.corners < 0) | (faces.corners >= count))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(faces.sizes), wrong[0], side="right"))
        raise ModelError(
            f"{faces.place(face)}: vertex {faces.corners[wrong[0]]} does not exist; expected 0 to "
            f"{count - 1}: the file is damaged, export it again"
        )
