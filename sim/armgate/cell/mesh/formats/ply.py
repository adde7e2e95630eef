"""Reader of PLY files: ascii, binary_little_endian and binary_big_endian.

The header declares elements (vertex, face, …) with their counts and properties; the body contains their rows,
element by element. All rows are read, also those of ignored elements, so that a wrong count cannot shift the
rows after it.
"""

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.faces import Faces
from armgate.cell.mesh.formats.ply_header import BYTES, FLOATS, Element, Property, read_header
from armgate.cell.mesh.formats.tokens import lines_of, numbers, shown, whole

_CORNERS = (b"vertex_indices", b"vertex_index")
_AXES = (b"x", b"y", b"z")
_NEEDED = (*_AXES, *_CORNERS)
"""Columns whose values must be finite; the values of other columns may be NaN or infinite."""

Row = list[Sequence[float]]


def read_ply(data: bytes) -> Faces:
    """Read a PLY file.

    Raises:
        ModelError: The file is damaged, or contains something not supported; the text gives the place.
    """
    order, elements, body = read_header(data)
    rows = _TextRows(data, body) if order == "" else _BinaryRows(data, body, order)
    vertices = np.zeros((0, 3))
    faces = Faces.of(vertices, [], [], [])
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
    return Faces(vertices, faces.corners, faces.sizes, faces.lines)


# --- rows ---------------------------------------------------------------------------------------------------


class _TextRows:
    """Rows of an ascii body, one in each line."""

    def __init__(self, data: bytes, body: int) -> None:
        self._line = len(data[:body].splitlines())
        self._lines = iter(lines_of(data[body:]))

    def take(self, element: Element, number: int) -> Row:
        """Return the values of the next row, column by column.

        Raises:
            ModelError: The file ends, or the row does not fit its element.
        """
        words = self._nonempty_line()
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

    def _read(self, words: list[bytes], column: Property) -> Sequence[float]:
        if column.name not in _NEEDED:
            return self._any(words)
        if column.kind in FLOATS:
            return numbers(words, self._line)
        return [whole(word, self._line) for word in words]

    def _any(self, words: list[bytes]) -> list[float]:
        """Read numbers, finite or not: a normal need not be finite."""
        try:
            return [float(word) for word in words]
        except ValueError:
            text = f"line {self._line}: {shown(b' '.join(words))}; expected numbers: export the file again"
            raise ModelError(text) from None

    def _nonempty_line(self) -> list[bytes] | None:
        for text in self._lines:
            self._line += 1
            words = text.split()
            if words:
                return words
        return None

    def line(self) -> list[int]:
        """Return the line of the last row."""
        return [self._line]

    def finish(self) -> None:
        """Raise a ModelError if something follows the last row."""
        words = self._nonempty_line()
        if words is not None:
            raise ModelError(
                f"line {self._line}: {shown(words[0])} follows the last row; expected the end of the file: "
                f"the counts in its header are wrong"
            )


class _BinaryRows:
    """Rows of a binary body."""

    def __init__(self, data: bytes, body: int, order: str) -> None:
        self._data, self._at, self._order = data, body, order

    def take(self, element: Element, number: int) -> Row:
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

    def _unpack(self, kind: str, size: int, element: Element, number: int) -> Sequence[float]:
        form = f"{self._order}{size}{kind}"
        end = self._at + size * BYTES[kind]
        if end > len(self._data):
            raise ModelError(_cut_off(element, number))
        values = struct.unpack_from(form, self._data, self._at)
        self._at = end
        return values

    def line(self) -> list[int]:
        """Return an empty list: a binary file has no lines."""
        return []

    def finish(self) -> None:
        """Raise a ModelError if something follows the last row."""
        left = len(self._data) - self._at
        if left:
            raise ModelError(
                f"byte {self._at}: {left} bytes follow the last row; expected the end of the file: the "
                f"counts in its header are wrong"
            )


def _cut_off(element: Element, number: int) -> str:
    return (
        f"the file ends after {number} of {element.rows} rows of the element {shown(element.name)}: it is "
        f"truncated, or the counts in its header are wrong; export it again"
    )


# --- vertices and faces ---------------------------------------------------------------------------------


def _vertices(element: Element, rows: _TextRows | _BinaryRows) -> NDArray[np.float64]:
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
            raise ModelError(f"vertex {number}: a coordinate is not a finite number; export the file again")
        flat += values
    return np.array(flat, dtype=np.float64).reshape(-1, 3)


def _faces(element: Element, rows: _TextRows | _BinaryRows) -> Faces:
    place = element.column(*_CORNERS)
    column = element.columns[place]
    if column.count is None or column.kind in FLOATS:
        raise ModelError(f"the property {shown(column.name)} is not a list of whole numbers; expected one")
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
    return Faces.of(np.zeros((0, 3)), corners, sizes, lines)


def _check_corners(faces: Faces, count: int) -> None:
    wrong = np.flatnonzero((faces.corners < 0) | (faces.corners >= count))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(faces.sizes), wrong[0], side="right"))
        raise ModelError(
            f"{faces.place(face)}: vertex {faces.corners[wrong[0]]} does not exist; expected 0 to "
            f"{count - 1}: the file is damaged, export it again"
        )
