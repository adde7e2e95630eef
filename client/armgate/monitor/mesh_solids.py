"""Solids of a mesh, which lie inside the parts that the gate uses for it.

The gate's parts contain the mesh and its interior. To raise no false alarm, the monitor uses smaller solids:
the convex hull if the configuration specifies ``hull``; else each connected piece of the surface, as its hull
if the piece is convex, and as its triangles if not. Boxes around them serve as a bounding hierarchy.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.convex_solid import Array, Solid, box_around, hull
from armgate.monitor.mesh_files import Mesh

FEW = 8
"""Largest number of points of a solid that needs no box around it."""

MAX_CORNERS = 512
_FLAT = 1e-9
"""Tolerance of the convexity test: distance of a corner from a face, as a share of the extent."""
_BLOCK = 4_000_000


def surface(triangles: Array) -> Solid:
    """Return the solid of triangles (t, 3, 3): nested boxes, opened only when they are close."""
    if len(triangles) == 1:
        return hull(triangles[0])
    return box_around(triangles.reshape(-1, 3), 0.0, lambda: _halves(triangles))


def _halves(triangles: Array) -> tuple[Solid, ...]:
    centres = triangles.mean(axis=1)
    order = np.argsort(centres[:, int(np.argmax(np.ptp(centres, axis=0)))], kind="stable")
    half = len(order) // 2
    return surface(triangles[order[:half]]), surface(triangles[order[half:]])


def boxed(solid: Solid) -> Solid:
    """Return the solid itself, or a box around it if it has many corners."""
    if len(solid.points) <= FEW:
        return solid
    return box_around(solid.points, solid.radius, lambda: (solid,))


def solids_of(mesh: Mesh, scale: Sequence[float], method: str) -> list[Solid]:
    """Return the solids that the monitor checks for a mesh.

    Args:
        mesh: Its vertices and triangles.
        scale: Factor per axis, to m.
        method: ``hull`` or ``parts``.
    """
    vertices = mesh.vertices * np.array(scale)
    if method == "hull":
        return [boxed(hull(_thinned(vertices)))]
    return [_piece(vertices, mesh.triangles[rows]) for rows in _components(mesh)]


def _piece(vertices: Array, triangles: NDArray[np.int64]) -> Solid:
    points = vertices[np.unique(triangles)]
    corners = vertices[triangles]
    return boxed(hull(_thinned(points))) if _is_convex(points, corners) else surface(corners)


def _components(mesh: Mesh) -> list[NDArray[np.int64]]:
    """Return the rows of the triangles of each connected piece."""
    label = np.arange(len(mesh.vertices))
    while True:
        lowest = label[mesh.triangles].min(axis=1)
        new = label.copy()
        for column in mesh.triangles.T:
            np.minimum.at(new, column, lowest)
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    of_triangle = label[mesh.triangles[:, 0]]
    return [np.flatnonzero(of_triangle == piece) for piece in np.unique(of_triangle)]


def _is_convex(points: Array, corners: Array) -> bool:
    """Return True if all corners lie on one side of the plane of each triangle.

    Pieces that are too large for a quick test count as not convex.
    """
    if len(points) * len(corners) > _BLOCK:
        return False
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    size = float(np.ptp(points, axis=0).max())
    solid = lengths > _FLAT * size * size
    normals = normals[solid] / lengths[solid, None]
    heights = points @ normals.T - np.einsum("ij,ij->i", normals, a[solid])
    slack = _FLAT * size
    return bool(np.all((heights.max(axis=0) <= slack) | (heights.min(axis=0) >= -slack)))


def _thinned(points: Array) -> Array:
    """Return at most ``MAX_CORNERS`` of the points, whose hull nearly fills the hull of all."""
    if len(points) <= MAX_CORNERS:
        return points
    k = np.arange(MAX_CORNERS) + 0.5
    z, angle = 1.0 - 2.0 * k / MAX_CORNERS, k * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - z * z)
    directions = np.stack([level * np.cos(angle), level * np.sin(angle), z])
    return np.asarray(points[np.unique((points @ directions).argmax(axis=0))])
