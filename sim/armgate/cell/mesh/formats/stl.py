"""Reader of STL files, ASCII and binary.

A binary file has a header of 80 bytes, the number N of triangles, and N records of 50 bytes. Its length is
exactly 84 + 50 N, which no text file of a permitted size can match: N would consist of four characters. The
header of a binary file may begin with "solid", so the length is checked first.

Normals and the two spare bytes of a record are ignored: only the corners matter to the gate.

An ASCII file is read by a table of states: each line begins with a statement, and the table gives the
statements that are allowed in the current state and the next state. Any other statement is refused.
"""

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.faces import Faces
from armgate.cell.mesh.formats.tokens import is_number, lines_of, numbers, shown

_HEAD = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])

_NEXT: dict[str, dict[bytes, str]] = {
    "the file": {b"solid": "a solid"},
    "a solid": {b"facet": "a facet", b"endsolid": "the file"},
    "a facet": {b"outer": "a loop"},
    "a loop": {b"vertex": "a loop", b"endloop": "a facet after its loop"},
    "a facet after its loop": {b"endfacet": "a solid"},
}
"""Statements of an ASCII file that may follow in each state, and the state after each."""

_FORMS: dict[bytes, tuple[int, str]] = {
    b"facet": (5, "facet normal X Y Z"),
    b"outer": (2, "outer loop"),
    b"vertex": (4, "vertex X Y Z"),
    b"endloop": (1, "endloop"),
    b"endfacet": (1, "endfacet"),
}
"""Number of words and form of the statements, for error messages."""

_SECOND = {b"facet": b"normal", b"outer": b"loop"}
"""Second word of the statements that have a fixed one."""


def read_stl(data: bytes) -> Faces:
    """Read an STL file.

    Raises:
        ModelError: The file is damaged; the text gives the line or byte.
    """
    count = int.from_bytes(data[80:_HEAD], "little")
    if len(data) >= _HEAD and len(data) == _HEAD + _RECORD.itemsize * count:
        return _binary(data)
    text = b"\0" not in data and data.removeprefix(b"\xef\xbb\xbf").lstrip()[:5].lower() == b"solid"
    if text:
        return _ascii(data)
    raise ModelError(_length_text(len(data), count))


def _length_text(length: int, count: int) -> str:
    if length < _HEAD:
        return (
            f"{length} bytes; expected a binary STL of at least {_HEAD} bytes, or a text that begins with "
            f"'solid': export it again"
        )
    wanted = _HEAD + _RECORD.itemsize * count
    what = f"{length - wanted} bytes follow the last triangle" if length > wanted else "the file is truncated"
    return (
        f"binary STL of {length} bytes, but its header announces {count} triangles, which take {wanted} "
        f"bytes: {what}; export it again"
    )


def _binary(data: bytes) -> Faces:
    corners = np.frombuffer(data, _RECORD, offset=_HEAD)["corners"]
    wrong = np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))
    if len(wrong):
        at = _HEAD + _RECORD.itemsize * int(wrong[0])
        raise ModelError(
            f"triangle {wrong[0] + 1} (byte {at}): a coordinate is not a finite number; export the file again"
        )
    return _triangles(corners.astype(np.float64).reshape(-1, 3))


def _ascii(data: bytes) -> Faces:
    lines, state, flat, start = lines_of(data), "the file", [], 0
    for line, text in enumerate(lines, start=1):
        words = text.split()
        if not words:
            continue
        word = words[0].lower()
        after = _NEXT[state].get(word)
        if after is None:
            raise ModelError(_unexpected(line, words[0], state))
        _check_form(word, words, line)
        if word == b"vertex":
            flat += numbers(words[1:], line)
        elif word == b"facet":
            _check_normal(words[2:], line)
            start = len(flat)
        elif word == b"endloop" and len(flat) - start != 9:
            raise ModelError(_wrong_corners(line, (len(flat) - start) // 3))
        state = after
    if state != "the file":
        raise ModelError(
            f"line {max(len(lines), 1)}: the file ends in {state}, without 'endsolid': it is truncated; "
            f"export it again"
        )
    return _triangles(np.array(flat, dtype=np.float64).reshape(-1, 3))


def _wrong_corners(line: int, corners: int) -> str:
    return f"line {line}: a facet with {corners} corners; expected 3: triangulate the mesh"


def _check_form(word: bytes, words: list[bytes], line: int) -> None:
    if word in _FORMS:
        count, form = _FORMS[word]
        second = _SECOND.get(word)
        if len(words) != count or (second is not None and words[1].lower() != second):
            raise ModelError(f"line {line}: {shown(b' '.join(words))}; expected '{form}'")
    elif b"facet" in map(bytes.lower, words[1:]) and b"normal" in map(bytes.lower, words[1:]):
        # A name may be any text up to the end of the line, so it would hide facets in that line.
        raise ModelError(
            f"line {line}: a facet is in the line of {shown(words[0])}; expected one statement in a line"
        )


def _check_normal(words: list[bytes], line: int) -> None:
    """Refuse words that are not numbers; the normal of a facet without an area need not be finite."""
    for word in words:
        if not is_number(word):
            raise ModelError(f"line {line}: {shown(word)} in a normal; expected a number")


def _unexpected(line: int, word: bytes, state: str) -> str:
    known = " or ".join(repr(each.decode()) for each in _NEXT[state])
    return f"line {line}: {shown(word)} in {state}; expected {known}: export the file again"


def _triangles(vertices: NDArray[np.float64]) -> Faces:
    count = len(vertices) // 3
    return Faces.of(vertices, np.arange(3 * count), np.full(count, 3), [])
