"""Proposes where to cut a mesh so that few convex parts follow it closely. Nothing depends on it but that.

It works on a coarse copy of the mesh: the cell whose hull holds the most emptiness is cut next, at the place
that leaves the hulls smallest after one more cut of each half through its middle (a ring gains nothing by its
first cut).
"""

from dataclasses import dataclass

import numpy as np

from armgate.cell.mesh.cells import Array, Cell, Surface, directions, split
from armgate.cell.mesh.files import Mesh
from armgate.cell.mesh.hull import hull_of
from armgate.cell.shapes import is_solid

_GRID = 16
_COARSE = 1500
_RAYS = 3
_PLACES = 3
_FLATS = 3
_PROBES = 96
_LEVEL = 1e-3
_THIN = 4e-6


@dataclass(frozen=True)
class Plane:
    """A cut of the leaf with this number, across an axis; its halves take its place in the list of leaves."""

    leaf: int
    axis: int
    at: float


def propose(mesh: Mesh, excess: float, most: int) -> list[Plane]:
    """Cuts, in order, until the parts' hulls are at most 1 + ``excess`` times the mesh, or are ``most``."""
    surface = Surface(_coarse(mesh), _RAYS)
    leaves = [surface.whole()]
    enough = excess * max(_filled(leaves[0]), 0.0)
    empty = [_empty(leaves[0])]
    planes: list[Plane] = []
    while len(leaves) < most and sum(empty) > enough:
        leaf = int(np.argmax(empty))
        found = _place(surface, leaves[leaf])
        if found is None or empty[leaf] <= 0.0:
            break
        planes.append(Plane(leaf, *found))
        halves = surface.cut(leaves[leaf], *found)
        leaves[leaf : leaf + 1] = halves
        empty[leaf : leaf + 1] = [_empty(half) for half in halves]
    return planes


def volume(points: Array) -> float:
    """About the volume of the convex hull of points, m³; 0 for flat ones."""
    some = _extreme(points)
    if not is_solid(some):
        return 0.0
    hull = hull_of(some)
    a, b, c = np.moveaxis(hull.vertices[hull.faces] - hull.vertices.mean(axis=0), 1, 0)
    return float(np.abs(np.einsum("fi,fi->f", a, np.cross(b, c))).sum() / 6.0)


def _extreme(points: Array) -> Array:
    """The points that are farthest in many directions: their hull is nearly that of all, and quick."""
    if len(points) <= _PROBES // 2:
        return points
    chosen: Array = points[np.unique((points @ _DIRECTIONS.T).argmax(axis=0))]
    return chosen


def _coarse(mesh: Mesh) -> Array:
    """The triangles with corners that are near to each other made one, if there are many."""
    if len(mesh.faces) <= _COARSE:
        return mesh.triangles
    low, size = mesh.vertices.min(axis=0), float(np.ptp(mesh.vertices, axis=0).max())
    cell = np.round((mesh.vertices - low) * (_GRID / size)).astype(np.int64)
    _, first, group = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    faces = group.reshape(-1)[mesh.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    triangles: Array = mesh.vertices[first][faces[whole]]
    return triangles if len(triangles) else mesh.triangles


# --- how much is empty --------------------------------------------------------------------------------------


def _empty(cell: Cell) -> float:
    """What of the hull of the cell's part is not in the mesh, m³."""
    return volume(cell.points) - _filled(cell)


def _filled(cell: Cell) -> float:
    """The volume of the mesh in a cell, m³, if it is wound in one sense: below each triangle, signed."""
    height = cell.high[2] - cell.low[2]
    below_top, above_top = split(cell.column, 2, float(cell.high[2]))
    above_top = above_top[above_top[:, :, 2].max(axis=1) > cell.high[2]]  # what is in the plane is in both
    inside = split(below_top, 2, float(cell.low[2]))[1]
    full = _level_area(above_top).sum() * height
    part = (_level_area(inside) * (inside[:, :, 2].mean(axis=1) - cell.low[2])).sum()
    return float(min(abs(full + part), np.prod(cell.high - cell.low)))


def _level_area(triangles: Array) -> Array:
    a, b, c = np.moveaxis(triangles[:, :, :2], 1, 0)
    u, v = b - a, c - a
    return np.asarray((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2.0)


# --- where to cut -------------------------------------------------------------------------------------------


def _place(surface: Surface, cell: Cell) -> tuple[int, float] | None:
    """The axis and the place of the best cut; of equally good ones that in the middle of the longest side."""
    places = [(axis, at) for axis in range(3) for at in _places(cell, axis)]
    if not places:
        return None
    sizes = np.array([sum(_halved(surface, half) for half in surface.cut(cell, *at)) for at in places])
    sides = cell.high - cell.low
    off = np.array([abs(at - (cell.low[k] + cell.high[k]) / 2.0) - sides[k] / 2.0 for k, at in places])
    best = np.flatnonzero(sizes <= sizes.min() + _LEVEL * volume(cell.points))
    return places[int(best[np.argmin(off[best])])]


def _halved(surface: Surface, cell: Cell) -> float:
    """The hull's volume, or that of two hulls if the best cut through the middle makes them smaller, m³."""
    sizes = [volume(cell.points)]
    for axis in range(3):
        if sizes[0] > 0.0 and cell.high[axis] - cell.low[axis] > _THIN:
            middle = float(cell.low[axis] + cell.high[axis]) / 2.0
            sizes.append(sum(volume(half.points) for half in surface.cut(cell, axis, middle)))
    return min(sizes)


def _places(cell: Cell, axis: int) -> list[float]:
    """The middle, some corners of the surface, and beside its largest flat faces across the axis.

    Beside, not in: what lies in a cut belongs to both parts.
    """
    low, high = float(cell.low[axis]), float(cell.high[axis])
    if high - low < _THIN:
        return []
    corners = np.unique(cell.triangles[:, :, axis])
    chosen = np.linspace(0, max(len(corners) - 1, 0), _PLACES + 2).round().astype(int)[1:-1]
    beside = _LEVEL * (high - low)
    flats = [at + sign * beside / 10.0 for at in _flats(cell.triangles, axis) for sign in (-1.0, 1.0)]
    spread = corners[chosen].tolist() if len(corners) else []
    every = np.unique([(low + high) / 2.0, *spread, *flats])
    inner: list[float] = every[(every > low + beside) & (every < high - beside)].tolist()
    return inner


def _flats(triangles: Array, axis: int) -> list[float]:
    """Where the largest faces across an axis are."""
    across = triangles[np.ptp(triangles[:, :, axis], axis=1) == 0.0]
    if len(across) == 0:
        return []
    a, b, c = np.moveaxis(across, 1, 0)
    heights, which = np.unique(a[:, axis], return_inverse=True)
    area = np.bincount(which.reshape(-1), np.linalg.norm(np.cross(b - a, c - a), axis=1))
    largest: list[float] = heights[np.argsort(-area, kind="stable")[:_FLATS]].tolist()
    return largest


_DIRECTIONS = directions(_PROBES)
