"""Cuts a surface along axis-parallel planes, so that the hulls of its pieces hold all that it encloses.

Let S be the surface with everything that it encloses: all that cannot be reached from far away without
crossing the surface. Let closed boxes (cells) cover S. Then

    S ∩ cell ⊂ hull( surface ∩ cell  ∪  { corners of the cell in S } )

because S ∩ cell is compact, so it lies in the hull of its extreme points, and each of these is of one of both
kinds: a point of S off the surface has a ball around it in S, so inside the cell, and within its faces and
edges, it is the middle of two others; only at a corner it need not be. The union of all such hulls therefore
contains S, whatever planes were chosen. Nothing has to be closed or wound in one sense for that.

A corner is left out only if a ray from it is proven to miss the surface: then it is connected to far away.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RAYS = 24
_SLACK = 1e-9
"""How much larger triangles are taken, in their own coordinates, so that no ray slips between two."""

_ROUNDING = 1e-14
_FLAT = 1e-9
"""A ray that makes a smaller angle with a triangle's plane counts as if it hit the triangle."""


@dataclass(frozen=True, eq=False)
class Cell:
    """A box of space and what of the surface is in it.

    Attributes:
        low, high: Its corners, (3,), m.
        triangles: The surface in it, (k, 3, 3), m.
        inner: Its corners that may be enclosed by the surface, (c, 3), m.
        column: The surface in it, above and below it, (n, 3, 3), m.
    """

    low: Array
    high: Array
    triangles: Array
    inner: Array
    column: Array

    @property
    def points(self) -> Array:
        """Points whose convex hull contains all of the mesh that is in the cell, (k, 3), m."""
        return np.concatenate([self.triangles.reshape(-1, 3), self.inner])


class Surface:
    """A surface of triangles (n, 3, 3), m, that cells are made of; ``rays`` are tried from a corner."""

    def __init__(self, triangles: Array, rays: int = RAYS) -> None:
        self._triangles, self._rays = triangles, directions(rays)
        self._known: dict[tuple[float, ...], bool] = {}

    def whole(self) -> Cell:
        """The cell of everything."""
        points = self._triangles.reshape(-1, 3)
        # No corner of it is inside: S does not reach beyond the extremes of its surface.
        return Cell(
            points.min(axis=0), points.max(axis=0), self._triangles, np.zeros((0, 3)), self._triangles
        )

    def cut(self, cell: Cell, axis: int, at: float) -> tuple[Cell, Cell]:
        """Both parts of a cell, below and above a plane across one axis; what is in the plane is in both.

        Raises:
            ValueError: The plane does not meet the cell.
        """
        if not cell.low[axis] <= at <= cell.high[axis]:
            raise ValueError(f"a cut at {at} does not meet a cell from {cell.low[axis]} to {cell.high[axis]}")
        below, above = split(cell.triangles, axis, at)
        columns = (cell.column, cell.column) if axis == 2 else split(cell.column, axis, at)
        high, low = cell.high.copy(), cell.low.copy()
        high[axis] = low[axis] = at
        return (
            Cell(cell.low, high, below, self._inner(cell.low, high), columns[0]),
            Cell(low, cell.high, above, self._inner(low, cell.high), columns[1]),
        )

    def _inner(self, low: Array, high: Array) -> Array:
        grid = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T
        return grid[[self._may_enclose(corner) for corner in grid]]

    def _may_enclose(self, corner: Array) -> bool:
        key = tuple(corner.tolist())
        if key not in self._known:
            self._known[key] = not proven_outside(corner, self._triangles, self._rays)
        return self._known[key]


def split(triangles: Array, axis: int, at: float) -> tuple[Array, Array]:
    """The parts of triangles (n, 3, 3) below and above a plane across one axis, as triangles.

    Each triangle is the union of its parts; what lies in the plane belongs to both.
    """
    height = triangles[:, :, axis] - at
    under, over = np.all(height <= 0.0, axis=1), np.all(height >= 0.0, axis=1)
    across = ~under & ~over
    lone, rest = _across(triangles[across], height[across], axis, at)
    up = (height[across] > 0.0).sum(axis=1) == 1  # the corner that is alone is above
    below = [triangles[under], lone[~up], *(part[up] for part in rest)]
    above = [triangles[over], lone[up], *(part[~up] for part in rest)]
    return np.concatenate(below), np.concatenate(above)


def _across(triangles: Array, height: Array, axis: int, at: float) -> tuple[Array, tuple[Array, Array]]:
    """Cuts triangles that have corners on both sides: the part with one corner, and the other one, as two."""
    positive = height > 0.0
    alone = np.where((positive.sum(axis=1) == 1)[:, None], positive, ~positive)
    turn = (np.argmax(alone, axis=1)[:, None] + np.arange(3)) % 3
    row = np.arange(len(triangles))[:, None]
    (a, b, c), (ha, hb, hc) = np.moveaxis(triangles[row, turn], 1, 0), height[row, turn].T
    p, q = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
    p[:, axis] = q[:, axis] = at
    return np.stack([a, p, q], axis=1), (np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1))


def proven_outside(point: Array, triangles: Array, rays: Array) -> bool:
    """Whether one of the rays from a point surely misses all triangles, so that they do not enclose it."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    u, v, s = b - a, c - a, point - a
    normal = np.cross(u, v)
    area = np.linalg.norm(normal, axis=1)
    size = np.sqrt(np.maximum(np.einsum("ij,ij->i", u, u), np.einsum("ij,ij->i", v, v)))
    far, thin = np.linalg.norm(s, axis=1) + size, _ROUNDING * size**2
    for ray in rays:
        lean = normal @ ray
        steep = np.abs(lean) > np.maximum(_FLAT * area, thin)
        safe = np.where(steep, lean, 1.0)
        slack = _SLACK + _ROUNDING * far * size / np.abs(safe)
        across = np.cross(s, ray)
        x, y = np.einsum("ij,ij->i", across, v) / -safe, np.einsum("ij,ij->i", across, u) / safe
        t = -np.einsum("ij,ij->i", s, normal) / safe
        missed = (x < -slack) | (y < -slack) | (x + y > 1.0 + 2.0 * slack) | (t < -slack * far)
        # A triangle without an area is a line: lines enclose nothing.
        if np.all(np.where(steep, missed, area <= thin)):
            return True
    return False


def directions(count: int) -> Array:
    """Directions all around (Fibonacci's sphere), none along an axis."""
    k = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * k / count, k * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - z * z)
    return np.stack([level * np.cos(angle), level * np.sin(angle), z], axis=1)
