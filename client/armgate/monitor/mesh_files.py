"""Vertices and triangles of mesh files: STL, OBJ, PLY and OFF, in text and binary form.

Content that does not fit the format is rejected, so that no part of a mesh is silently omitted.
"""

import codecs
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.errors import DescriptionError
from armgate.monitor.files import read_bytes

Array = NDArray[np.float64]

MAX_BYTES = 64 << 20
MAX_TRIANGLES = 200_000
_OFF_KINDS = ("OFF", "COFF", "NOFF")
_PLY_TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H",
    "uint16": "H", "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f",
    "double": "d", "float64": "d",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (v, 3) as in the file, and triangles as rows of vertex indices, (t, 3)."""

    vertices: Array
    triangles: NDArray[np.int64]


def read_mesh(file: Path) -> Mesh:
    """Read a mesh file.

    Raises:
        DescriptionError: It cannot be read, has another format, or is damaged.
    """
    data = read_bytes(file, MAX_BYTES, "mesh ")
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise DescriptionError(f"mesh {file}: expected one of {', '.join(_READERS)}")
    try:
        return _checked(*reader(data))
    except (ValueError, IndexError, KeyError, struct.error, OverflowError) as error:
        raise DescriptionError(f"mesh {file}: damaged, or not supported by the monitor: {error}") from error


def _checked(vertices: Array, faces: Sequence[Sequence[int]]) -> Mesh:
    triangles = [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]
    if any(len(face) < 3 for face in faces):
        raise ValueError("a face with fewer than 3 corners")
    if not triangles or len(triangles) > MAX_TRIANGLES:
        raise ValueError(f"{len(triangles)} triangles; expected 1 to {MAX_TRIANGLES}")
    indices = np.array(triangles, dtype=np.int64)
    if indices.min() < 0 or indices.max() >= len(vertices):
        raise ValueError("a face refers to a vertex that does not exist")
    used = np.unique(indices)
    if not np.all(np.isfinite(vertices[used])):
        raise ValueError("a coordinate is not finite")
    places = np.searchsorted(used, indices)
    unique, where = np.unique(vertices[used], axis=0, return_inverse=True)
    return Mesh(unique, where.reshape(-1)[places])


Parsed = tuple[Array, Sequence[Sequence[int]]]


def _stl(data: bytes) -> Parsed:
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(data, np.dtype([("v", "<f4", (12,)), ("a", "<u2")]), count, 84)
        corners = rows["v"][:, 3:].astype(np.float64).reshape(-1, 3)
    else:
        corners = _stl_text(data)
    return corners, np.arange(len(corners)).reshape(-1, 3).tolist()


def _rows(data: bytes, *, comments: bool = True) -> list[list[str]]:
    """Return the words of each line without comments (# to the end); names may have any encoding."""
    lines = data.removeprefix(codecs.BOM_UTF8).splitlines()
    texts = [line.split(b"#", 1)[0] for line in lines] if comments else lines
    return [[word.decode("latin-1") for word in text.split()] for text in texts]


def _stl_text(data: bytes) -> Array:
    """Return the corners of all facets of all solids."""
    words: list[str] = []
    for row in _rows(data, comments=False):
        named = row and row[0].lower() in ("solid", "endsolid")
        words += row[:1] if named else row
    if not words or words[0].lower() != "solid":
        raise ValueError("neither binary STL of the right length nor text that begins with 'solid'")
    corners: list[list[float]] = []
    opened = closed = facets = at = 0
    while at < len(words):
        word = words[at].lower()
        if word == "vertex":
            corners.append([float(x) for x in words[at + 1 : at + 4]])
            at += 3
        opened += word == "facet"
        facets += word == "endfacet"
        closed += word == "endsolid"
        at += 1
    if not closed or opened != facets or len(corners) != 3 * facets:
        raise ValueError("an incomplete text STL")
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _obj(data: bytes) -> Parsed:
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for word, *rest in _obj_statements(data):
        if word == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif word in ("f", "fo"):
            faces.append([_obj_index(part, len(vertices)) for part in rest])
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), faces


def _obj_statements(data: bytes) -> Iterator[list[str]]:
    """Yield the words of each statement; a backslash at the end of a line continues it."""
    begun: list[str] = []
    for row in _rows(data):
        continued = bool(row) and row[-1].endswith("\\")
        begun += [*row[:-1], row[-1][:-1]] if continued else row
        if begun and not continued:
            yield [word for word in begun if word]
            begun = []
    if begun:
        raise ValueError("the last statement is continued, but the file ends")


def _obj_index(part: str, known: int) -> int:
    """Return the zero-based index of a face's corner; a negative one counts back from the newest vertex."""
    index = int(part.split("/", 1)[0])
    if index == 0 or index < -known:
        raise ValueError(f"a face refers to the vertex {index}")
    return index - 1 if index > 0 else known + index


def _off(data: bytes) -> Parsed:
    rows = [row for row in _rows(data) if row]
    if not rows or rows[0][0].upper() not in _OFF_KINDS:
        raise ValueError(f"expected one of {', '.join(_OFF_KINDS)} first")
    head = 1 if len(rows[0]) > 1 else 2  # the counts may be in the first line
    counts = [int(word) for word in [*rows[0][1:], *(rows[1] if head == 2 and len(rows) > 1 else [])]]
    if len(counts) != 3:
        raise ValueError("expected the numbers of vertices, faces and edges after OFF")
    n_vertices, n_faces, _ = counts
    if min(n_vertices, n_faces) < 0 or len(rows) < head + n_vertices + n_faces:
        raise ValueError("fewer vertices or faces than the file specifies")
    points, polygons = rows[head : head + n_vertices], rows[head + n_vertices :][:n_faces]
    vertices = np.array([[float(x) for x in row[:3]] for row in points], dtype=np.float64).reshape(-1, 3)
    faces = [[int(x) for x in row[1 : 1 + int(row[0])]] for row in polygons]
    if any(len(face) != int(row[0]) for face, row in zip(faces, polygons, strict=True)):
        raise ValueError("a face with fewer corners than the file specifies")
    return vertices, faces


def _ply(data: bytes) -> Parsed:
    head, mark, body = data.partition(b"end_header")
    if not mark or not head.startswith(b"ply"):
        raise ValueError("no PLY header")
    body = body[2:] if body[:2] == b"\r\n" else body[1:]
    form, elements = _ply_header(_rows(head, comments=False))
    values = _Words(body) if form == "ascii" else _Bytes(body, "<" if "little" in form else ">")
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    for name, count, properties in elements:
        for _ in range(count):
            row = {key: values.take(length, kind) for key, length, kind in properties}
            if name == "vertex":
                vertices.append([float(row[axis][0]) for axis in "xyz"])
            elif name == "face":
                corners = row.get("vertex_indices") or row.get("vertex_index") or ()
                faces.append([int(x) for x in corners])
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), faces


Property = tuple[str, str, str]
"""Name, type of the length of a list ("" for a single value), and type of the values."""


def _ply_header(rows: list[list[str]]) -> tuple[str, list[tuple[str, int, list[Property]]]]:
    form, elements = "", list[tuple[str, int, list[Property]]]()
    for row in rows[1:]:
        match row:
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, _]:
                pass
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", "list", length, kind, name]:
                elements[-1][2].append((name, _PLY_TYPES[length], _PLY_TYPES[kind]))
            case ["property", kind, name] if kind in _PLY_TYPES:
                elements[-1][2].append((name, "", _PLY_TYPES[kind]))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"unknown header line {' '.join(row):.60}")
    if not form or sum(count for _, count, _ in elements) > 4 * MAX_TRIANGLES:
        raise ValueError("no format, or too many elements")
    return form, elements


class _Words:
    """Values of a PLY file in text form."""

    def __init__(self, body: bytes) -> None:
        self._words = iter(body.split())

    def take(self, length: str, _kind: str) -> Sequence[float]:
        """Return the values of the next property."""
        count = int(next(self._words, b"")) if length else 1
        return [float(next(self._words, b"")) for _ in range(_bounded(count))]


class _Bytes:
    """Values of a PLY file in binary form."""

    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order, self._at = body, order, 0

    def take(self, length: str, kind: str) -> Sequence[float]:
        """Return the values of the next property."""
        count = int(self._unpacked(length)[0]) if length else 1
        return self._unpacked(f"{_bounded(count)}{kind}")

    def _unpacked(self, form: str) -> Sequence[float]:
        values = struct.unpack_from(self._order + form, self._body, self._at)
        self._at += struct.calcsize(self._order + form)
        return values


def _bounded(count: int) -> int:
    if not 0 <= count <= MAX_TRIANGLES:
        raise ValueError(f"a list of {count} values")
    return count


_READERS = {".stl": _stl, ".obj": _obj, ".ply": _ply, ".off": _off}
