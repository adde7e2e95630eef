"""Faces of a mesh file and their triangulation.

A face with more than three corners is accepted if it is flat and convex, both up to ``FLAT`` of its extent.
It becomes a fan of triangles around its first corner. The deviation from a flat, convex polygon is measured:
every point of the hull of the face's corners lies within ``slack`` of the fan. Bodies that contain the fan,
thickened by ``slack``, therefore contain the face, in whichever way another program triangulates it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MAX_CORNERS = 1024
FLAT = 1e-3
"""Largest deviation of a polygon from a flat, convex one, as a share of its extent."""

_LINE = 1e-6
"""Share of the extent below which the direction of an edge or polygon is lost in rounding errors."""

_BLOCK = 1 << 20
"""Largest number of distances between corners and edges that are computed at once; bounds memory."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces in the order of a file.

    Attributes:
        vertices: Coordinates in the file's unit, (v, 3).
        corners: Vertex indices of all faces, face by face.
        sizes: Number of corners of each face, (f,).
        lines: Line of each face, counted from 1; empty if the file is binary.
    """

    vertices: Array
    corners: Index
    sizes: Index
    lines: Index

    @classmethod
    def of(
        cls, vertices: Array, corners: list[int] | Index, sizes: list[int] | Index, lines: list[int]
    ) -> "Faces":
        """Return the faces of plain lists."""
        whole = (np.asarray(given, dtype=np.int64) for given in (corners, sizes, lines))
        return cls(np.asarray(vertices, dtype=np.float64).reshape(-1, 3), *whole)

    def place(self, face: int) -> str:
        """Return the place of a face in the file, for error messages."""
        return f"line {self.lines[face]}" if len(self.lines) else f"face {face + 1}"


def triangulate(faces: Faces, vertices: Array) -> tuple[Index, float]:
    """Return the faces as triangles (t, 3), and the slack of the polygons among them, m.

    Args:
        faces: The faces.
        vertices: Their vertices in m.

    Raises:
        ModelError: A polygon is not flat, not convex, or has too many corners; the text gives its place.
    """
    first = np.cumsum(faces.sizes) - faces.sizes
    found, slack = [np.zeros((0, 3), dtype=np.int64)], 0.0
    for size in np.unique(faces.sizes).tolist():
        chosen = np.flatnonzero(faces.sizes == size)
        rows = faces.corners[first[chosen][:, None] + np.arange(size)]
        if size > 3:
            slack = max(slack, _slack_of(faces, chosen, vertices[rows]))
        found.append(_fans(rows))
    return np.concatenate(found), slack


def _fans(rows: Index) -> Index:
    first = np.repeat(rows[:, :1], rows.shape[1] - 2, axis=1)
    fans: Index = np.stack([first, rows[:, 1:-1], rows[:, 2:]], axis=2).reshape(-1, 3)
    return fans


def _slack_of(faces: Faces, chosen: Index, polygons: Array) -> float:
    """Return the largest slack of polygons (m, k, 3) with the same number of corners, m."""
    corners = polygons.shape[1]
    if corners > MAX_CORNERS:
        raise ModelError(
            f"{faces.place(int(chosen[0]))}: a face with {corners} corners; expected at most {MAX_CORNERS}: "
            f"triangulate the mesh"
        )
    block, slack = max(1, _BLOCK // corners**2), 0.0
    for start in range(0, len(chosen), block):
        extent, bent, concave = _deviations(polygons[start : start + block])
        for deviation, word in ((bent, "flat"), (concave, "convex")):
            worst = int(np.argmax(deviation))
            if deviation[worst] > FLAT:
                raise ModelError(
                    f"{faces.place(int(chosen[start + worst]))}: a face with {corners} corners that is not "
                    f"{word}; expected triangles, or flat and convex polygons: triangulate the mesh"
                )
        slack = max(slack, float((4.0 * extent * (bent + concave)).max()))
    return slack


def _deviations(polygons: Array) -> tuple[Array, Array, Array]:
    """Return the extent [m] of polygons (m, k, 3), and two shares of it, (m,) each.

    The first share is the thickness across the best-fitting plane. The second share is the depth by which a
    corner lies on the outer side of the line through an edge. Both are 0 for a flat, convex polygon.
    """
    away = polygons - polygons.mean(axis=1, keepdims=True)
    extent = np.linalg.norm(away, axis=2).max(axis=1)
    away = away / np.where(extent > 0.0, extent, 1.0)[:, None, None]
    _, _, axes = np.linalg.svd(away, full_matrices=True)
    x, y, z = np.moveaxis(away @ np.swapaxes(axes, 1, 2), 2, 0)
    bent = np.ptp(z, axis=1)
    thin = np.ptp(y, axis=1)
    return extent, bent, np.where(thin > _LINE, _concavity(x, y), thin)


def _concavity(x: Array, y: Array) -> Array:
    """Return the largest distance of a corner beyond the line of an edge, for plane polygons (m, k)."""
    u, v = np.roll(x, -1, axis=1) - x, np.roll(y, -1, axis=1) - y
    length = np.hypot(u, v)
    turn = np.sign((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    u, v = (np.where(length > _LINE, part / np.maximum(length, _LINE), 0.0) for part in (u, v))
    inward = u[:, :, None] * (y[:, None, :] - y[:, :, None]) - v[:, :, None] * (x[:, None, :] - x[:, :, None])
    depths = np.maximum(-(inward * turn[:, None, None]).min(axis=(1, 2)), 0.0)
    return np.where(turn == 0.0, np.inf, depths)  # zero area but not a line: the polygon crosses itself
