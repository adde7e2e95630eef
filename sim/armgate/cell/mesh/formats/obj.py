"""Reader of Wavefront OBJ files: polygons of all objects and groups as one surface.

Statements that add no surface are ignored (``_IGNORED``). All others are refused by name: free-form curves
and surfaces, points, lines and calls of other files would be missing in the bodies.
"""

import re
from collections.abc import Iterator

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.faces import Faces
from armgate.cell.mesh.formats.tokens import is_number, lines_of, numbers, shown, whole, without_comment

_IGNORED = frozenset(
    b"o g s mg usemtl mtllib usemap maplib lod bevel c_interp d_interp shadow_obj trace_obj".split()
)
"""Statements for names, groups, smoothing, materials and display attributes."""

_INDEX = re.compile(rb"-?\d+(/-?\d*){0,2}")

_NUMBERS = {b"vn": (3,), b"vt": (1, 2, 3)}
"""Number of values of normals and texture coordinates, which are ignored as well."""

_VERTEX = {3: "x y z", 4: "x y z w", 6: "x y z r g b", 7: "x y z w r g b"}
"""Forms of a vertex by number of values."""


def read_obj(data: bytes) -> Faces:
    """Read an OBJ file.

    Raises:
        ModelError: The file is damaged, or contains something not supported; the text gives the line.
    """
    flat: list[float] = []
    corners: list[int] = []
    sizes: list[int] = []
    places: list[int] = []
    for line, words in _statements(data):
        word = words[0]
        if word == b"v":
            flat += _vertex(words, line)
        elif word in (b"f", b"fo"):
            corners += _face(words, line, len(flat) // 3)
            sizes.append(len(words) - 1)
            places.append(line)
        elif word in _NUMBERS:
            _check_numbers(words, line)
        elif word in _IGNORED:
            _check_name(words, line)
        else:
            raise ModelError(
                f"line {line}: the statement {shown(word)} is not supported; expected v and f only, besides "
                f"names, materials and normals: export polygons"
            )
    _check_indices(corners, sizes, places, len(flat) // 3)
    return Faces.of(np.array(flat, dtype=np.float64), corners, sizes, places)


def _statements(data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """Yield first line and words of each statement, without comments and with continued lines joined."""
    begun: list[bytes] = []
    first = 0
    for line, raw in enumerate(lines_of(data), start=1):
        text = without_comment(raw)
        continued = text.endswith(b"\\")
        words = (text[:-1] if continued else text).split()
        if not begun:
            first = line
        begun += words
        if continued and begun and begun[0] in _IGNORED:
            # A name that ends in a backslash, such as a Windows folder, must not hide the next statement.
            raise ModelError(f"line {line}: a name that ends in a backslash; expected none there: rename it")
        if begun and not continued:
            yield first, begun
            begun = []
    if begun:
        raise ModelError(
            f"line {first}: the statement is continued beyond the end of the file: it is truncated; "
            f"export it again"
        )


def _check_name(words: list[bytes], line: int) -> None:
    """Refuse a name that ends like a face: a line end may have been lost before it."""
    tail = words[words.index(b"f", 1) + 1 :] if b"f" in words[1:] else []
    if len(tail) >= 3 and all(_INDEX.fullmatch(word) for word in tail):
        raise ModelError(
            f"line {line}: a face is in the line of {shown(words[0])}; expected one statement in a line"
        )


def _check_numbers(words: list[bytes], line: int) -> None:
    """Refuse anything but numbers: a face may have been merged into the line. A normal need not be finite."""
    if len(words) - 1 not in _NUMBERS[words[0]] or not all(map(is_number, words[1:])):
        raise ModelError(
            f"line {line}: {shown(b' '.join(words))}; expected {words[0].decode()} and its numbers"
        )


def _vertex(words: list[bytes], line: int) -> list[float]:
    values = numbers(words[1:], line)
    if len(values) not in _VERTEX:
        raise ModelError(f"line {line}: v with {len(values)} numbers; expected {', '.join(_VERTEX.values())}")
    if len(values) in (4, 7) and values[3] != 1.0:
        raise ModelError(f"line {line}: the weight of a vertex is {values[3]:g}; expected 1 or none")
    return values[:3]


def _face(words: list[bytes], line: int, known: int) -> list[int]:
    """Return the corners of a face, counted from 0; relative indices count back from the last vertex."""
    if len(words) < 4:
        raise ModelError(f"line {line}: a face with {len(words) - 1} corners; expected at least 3")
    found = []
    for word in words[1:]:
        vertex, *rest = word.split(b"/")
        if len(rest) > 2 or any(part and whole(part, line) == 0 for part in rest):
            raise ModelError(f"line {line}: {shown(word)}; expected v, v/vt, v//vn or v/vt/vn")
        index = whole(vertex, line)
        if index == 0 or index < -known:
            raise ModelError(
                f"line {line}: vertex {index} does not exist; expected 1, 2, … or -1 (the last one) to "
                f"-{known}"
            )
        found.append(index - 1 if index > 0 else known + index)
    return found


def _check_indices(corners: list[int], sizes: list[int], places: list[int], count: int) -> None:
    if corners and max(corners) >= count:
        first = next(at for at, corner in enumerate(corners) if corner >= count)
        face = int(np.searchsorted(np.cumsum(sizes), first, side="right"))
        raise ModelError(
            f"line {places[face]}: vertex {corners[first] + 1} does not exist; the file has {count}: it is "
            f"damaged or truncated, export it again"
        )
