"""Reader of OFF files in text form: OFF, COFF (with colours) and NOFF (with normals)."""

from collections.abc import Iterator

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.faces import Faces
from armgate.cell.mesh.formats.tokens import lines_of, numbers, shown, whole, wholes, without_comment

_VERTEX = {b"OFF": (3,), b"COFF": (6, 7), b"NOFF": (6,)}
"""Numbers of values of a vertex: coordinates, then a colour of 3 or 4 values, or a normal."""

_COLOURS = (0, 1, 3, 4)
"""Numbers of values that may follow a face: none, the index of a colour, or a colour."""

Lines = Iterator[tuple[int, list[bytes]]]


def read_off(data: bytes) -> Faces:
    """Read an OFF file.

    Raises:
        ModelError: The file is damaged, or has a form that is not supported; the text gives the line.
    """
    lines = _nonempty_lines(data)
    kind, vertex_count, face_count = _header(lines)
    flat: list[float] = []
    for number in range(vertex_count):
        line, words = _next_line(lines, "vertex", number, vertex_count)
        values = numbers(words, line)
        if len(values) not in _VERTEX[kind]:
            wanted = " or ".join(map(str, _VERTEX[kind]))
            raise ModelError(f"line {line}: a vertex with {len(values)} numbers; expected {wanted}")
        flat += values[:3]
    corners: list[int] = []
    sizes: list[int] = []
    places: list[int] = []
    for number in range(face_count):
        line, words = _next_line(lines, "face", number, face_count)
        face = _face(words, line, vertex_count)
        corners += face
        sizes.append(len(face))
        places.append(line)
    for line, words in lines:
        raise ModelError(
            f"line {line}: {shown(words[0])} follows the last of {face_count} faces; expected the end of the "
            f"file: the counts in its header are wrong"
        )
    return Faces.of(np.array(flat, dtype=np.float64), corners, sizes, places)


def _nonempty_lines(data: bytes) -> Lines:
    """Yield number and words of each line that is not empty, without comments."""
    for line, text in enumerate(lines_of(data), start=1):
        words = without_comment(text).split()
        if words:
            yield line, words


def _header(lines: Lines) -> tuple[bytes, int, int]:
    """Return the kind of the file and the numbers of vertices and faces."""
    line, words = next(lines, (1, [b""]))
    kind, counts = words[0].upper(), words[1:]
    if kind not in _VERTEX:
        known = ", ".join(sorted(each.decode() for each in _VERTEX))
        raise ModelError(f"line {line}: begins with {shown(words[0])}; expected one of {known}, as text")
    if not counts:
        line, counts = next(lines, (line, []))
    if len(counts) != 3:
        raise ModelError(
            f"line {line}: {shown(b' '.join(counts))}; expected the numbers of vertices, faces and edges, "
            f"such as '8 12 0'"
        )
    given = wholes(counts, line)
    if min(given) < 0:
        raise ModelError(f"line {line}: a negative number of vertices, faces or edges; expected 0 or more")
    return kind, given[0], given[1]


def _next_line(lines: Lines, what: str, number: int, count: int) -> tuple[int, list[bytes]]:
    found = next(lines, None)
    if found is None:
        raise ModelError(
            f"the file ends after {number} of {count} {'vertices' if what == 'vertex' else 'faces'}: it is "
            f"truncated, or the counts in its header are wrong; export it again"
        )
    return found


def _face(words: list[bytes], line: int, vertices: int) -> list[int]:
    size = whole(words[0], line)
    if size < 3 or len(words) - 1 - size not in _COLOURS:
        raise ModelError(
            f"line {line}: a face of {len(words)} numbers that begins with {size}; expected its number of "
            f"corners (at least 3), the corners, and no more than a colour"
        )
    face = wholes(words[1 : 1 + size], line)
    numbers(words[1 + size :], line)
    for vertex in face:
        if not 0 <= vertex < vertices:
            raise ModelError(f"line {line}: vertex {vertex} does not exist; expected 0 to {vertices - 1}")
    return face
