"""Choice of the planes along which a mesh is cut, so that few convex bodies follow it closely.

The choice affects only the closeness: any planes give bodies that contain the mesh. It works on a coarse copy
of the mesh. The piece whose hull has the most empty volume is cut next, at the plane that leaves the smallest
hulls after one more cut of each half through its middle: a single cut of a ring does not reduce its hulls.
"""

from dataclasses import dataclass

import numpy as np

from armgate.cell.mesh.decomposition.cutting import Array, Piece, Surface, directions, split
from armgate.cell.mesh.hull import hull_of
from armgate.cell.mesh.triangle_mesh import TriangleMesh
from armgate.cell.shapes import is_solid

_GRID = 16
"""Resolution of the coarse copy: number of grid steps along its longest side."""
_COARSE = 1500
"""Largest number of triangles that need no coarse copy."""
_RAYS = 3
"""Rays from a corner of a box; here an error only makes the bodies less close to the mesh."""
_PLACES = 3
"""Planes through corners of the surface that are tried, for each axis."""
_FLATS = 3
"""Planes beside flat faces that are tried, for each axis."""
_PROBES = 96
"""Directions in which extreme points are searched."""
_LEVEL = 1e-3
"""Difference below which two volumes count as equal, and distance kept from a face, as shares."""
_THIN = 4e-6
"""Thickness below which a piece is not cut, m."""


@dataclass(frozen=True)
class Plane:
    """Cut across an axis, at a coordinate [m], of the piece at an index in the list of pieces.

    Its halves replace the piece in the list.
    """

    piece: int
    axis: int
    at: float


def propose_planes(mesh: TriangleMesh, excess: float, most: int) -> list[Plane]:
    """Return planes in order, until the hulls exceed the mesh by at most ``excess`` of its volume.

    There are at most ``most`` pieces after all cuts.
    """
    surface = Surface(_coarse(mesh), _RAYS)
    pieces = [surface.whole()]
    enough = excess * max(_filled(pieces[0]), 0.0)
    empty = [_empty(pieces[0])]
    planes: list[Plane] = []
    while len(pieces) < most and sum(empty) > enough:
        piece = int(np.argmax(empty))
        found = _best_plane(surface, pieces[piece])
        if found is None or empty[piece] <= 0.0:
            break
        planes.append(Plane(piece, *found))
        halves = surface.cut(pieces[piece], *found)
        pieces[piece : piece + 1] = halves
        empty[piece : piece + 1] = [_empty(half) for half in halves]
    return planes


def hull_volume(points: Array) -> float:
    """Return the approximate volume of the convex hull of points, m³; 0 for flat ones."""
    some = _extreme(points)
    if not is_solid(some):
        return 0.0
    hull = hull_of(some)
    a, b, c = np.moveaxis(hull.vertices[hull.faces] - hull.vertices.mean(axis=0), 1, 0)
    return float(np.abs(np.einsum("fi,fi->f", a, np.cross(b, c))).sum() / 6.0)


def _extreme(points: Array) -> Array:
    """Return the points that are farthest in many directions: their hull is nearly that of all points."""
    if len(points) <= _PROBES // 2:
        return points
    chosen: Array = points[np.unique((points @ _DIRECTIONS.T).argmax(axis=0))]
    return chosen


def _coarse(mesh: TriangleMesh) -> Array:
    """Return the triangles; if there are many, with nearby corners merged."""
    if len(mesh.faces) <= _COARSE:
        return mesh.triangles
    low, size = mesh.vertices.min(axis=0), float(np.ptp(mesh.vertices, axis=0).max())
    cell = np.round((mesh.vertices - low) * (_GRID / size)).astype(np.int64)
    _, first, group = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    faces = group.reshape(-1)[mesh.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    triangles: Array = mesh.vertices[first][faces[whole]]
    return triangles if len(triangles) else mesh.triangles


# --- empty volume -----------------------------------------------------------------------------------------


def _empty(piece: Piece) -> float:
    """Return the volume of a piece's hull that is not in the mesh, m³."""
    return hull_volume(piece.points) - _filled(piece)


def _filled(piece: Piece) -> float:
    """Return the volume of the mesh in a box, m³, as a sum of signed volumes (consistent winding)."""
    height = piece.high[2] - piece.low[2]
    below_top, above_top = split(piece.column, 2, float(piece.high[2]))
    above_top = above_top[above_top[:, :, 2].max(axis=1) > piece.high[2]]  # both contain the plane
    inside = split(below_top, 2, float(piece.low[2]))[1]
    full = _level_area(above_top).sum() * height
    part = (_level_area(inside) * (inside[:, :, 2].mean(axis=1) - piece.low[2])).sum()
    return float(min(abs(full + part), np.prod(piece.high - piece.low)))


def _level_area(triangles: Array) -> Array:
    """Return the signed areas of triangles (n, 3, 3) projected along z, (n,), m²."""
    a, b, c = np.moveaxis(triangles[:, :, :2], 1, 0)
    u, v = b - a, c - a
    return np.asarray((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2.0)


# --- candidates -------------------------------------------------------------------------------------------


def _best_plane(surface: Surface, piece: Piece) -> tuple[int, float] | None:
    """Return axis and coordinate of the best plane; among equal ones the middle one of the longest side."""
    planes = [(axis, at) for axis in range(3) for at in _candidates(piece, axis)]
    if not planes:
        return None
    sizes = np.array([sum(_halved(surface, half) for half in surface.cut(piece, *plane)) for plane in planes])
    sides = piece.high - piece.low
    off = np.array([abs(at - (piece.low[k] + piece.high[k]) / 2.0) - sides[k] / 2.0 for k, at in planes])
    best = np.flatnonzero(sizes <= sizes.min() + _LEVEL * hull_volume(piece.points))
    return planes[int(best[np.argmin(off[best])])]


def _halved(surface: Surface, piece: Piece) -> float:
    """Return the hull's volume, or that of two hulls if the best cut through the middle is smaller, m³."""
    sizes = [hull_volume(piece.points)]
    for axis in range(3):
        if sizes[0] > 0.0 and piece.high[axis] - piece.low[axis] > _THIN:
            middle = float(piece.low[axis] + piece.high[axis]) / 2.0
            sizes.append(sum(hull_volume(half.points) for half in surface.cut(piece, axis, middle)))
    return min(sizes)


def _candidates(piece: Piece, axis: int) -> list[float]:
    """Return the middle, some corners of the surface, and both sides of its largest flat faces.

    The planes are beside the faces, because a face in a plane would belong to both parts.
    """
    low, high = float(piece.low[axis]), float(piece.high[axis])
    if high - low < _THIN:
        return []
    corners = np.unique(piece.triangles[:, :, axis])
    chosen = np.linspace(0, max(len(corners) - 1, 0), _PLACES + 2).round().astype(int)[1:-1]
    beside = _LEVEL * (high - low)
    flats = [at + sign * beside / 10.0 for at in _flats(piece.triangles, axis) for sign in (-1.0, 1.0)]
    spread = corners[chosen].tolist() if len(corners) else []
    every = np.unique([(low + high) / 2.0, *spread, *flats])
    inner: list[float] = every[(every > low + beside) & (every < high - beside)].tolist()
    return inner


def _flats(triangles: Array, axis: int) -> list[float]:
    """Return the coordinates of the largest flat faces across an axis."""
    across = triangles[np.ptp(triangles[:, :, axis], axis=1) == 0.0]
    if len(across) == 0:
        return []
    a, b, c = np.moveaxis(across, 1, 0)
    heights, which = np.unique(a[:, axis], return_inverse=True)
    area = np.bincount(which.reshape(-1), np.linalg.norm(np.cross(b - a, c - a), axis=1))
    largest: list[float] = heights[np.argsort(-area, kind="stable")[:_FLATS]].tolist()
    return largest


_DIRECTIONS = directions(_PROBES)
