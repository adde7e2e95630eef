"""Cutting of a surface along axis-parallel planes, so that the pieces' hulls contain all that it encloses.

Let S be the surface with everything that it encloses: all points that no path from infinity reaches without
crossing the surface. Let closed boxes cover S. Then

    S ∩ box ⊂ hull( surface ∩ box  ∪  { corners of the box in S } )

because S ∩ box is compact, so it lies in the hull of its extreme points, and each extreme point is of one of
these two kinds. A point of S off the surface has a ball around it in S. Inside the box, and inside its faces
and edges, such a point is the middle of two other points; only at a corner of the box it need not be. The
union of all such hulls therefore contains S for any choice of planes. The surface need not be closed or
consistently wound.

A corner is left out only if a ray from it is proven to miss the surface: then a path to
infinity exists.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RAYS = 24
"""Number of rays that are tried from a corner."""

_SLACK = 1e-9
"""Enlargement of the triangles, in their own coordinates, so that no ray passes between two of them."""

_ROUNDING = 1e-14
"""Bound of relative rounding errors."""

_FLAT = 1e-9
"""Angle between a ray and the plane of a triangle below which the ray counts as a hit."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Box of space and the part of the surface in it.

    Attributes:
        low: Corner of the box with the smallest coordinates, (3,), m.
        high: Corner of the box with the largest coordinates, (3,), m.
        triangles: Surface in the box, (k, 3, 3), m.
        inner: Corners of the box that the surface may enclose, (c, 3), m.
        column: Surface in the box, above it and below it, (n, 3, 3), m.
    """

    low: Array
    high: Array
    triangles: Array
    inner: Array
    column: Array

    @property
    def points(self) -> Array:
        """Points whose convex hull contains everything of the mesh that is in the box, (k, 3), m."""
        return np.concatenate([self.triangles.reshape(-1, 3), self.inner])


class Surface:
    """Surface of triangles (n, 3, 3), m, to be cut into pieces.

    Args:
        triangles: The triangles.
        rays: Number of rays that are tried from a corner.
    """

    def __init__(self, triangles: Array, rays: int = RAYS) -> None:
        self._triangles, self._rays = triangles, directions(rays)
        self._known: dict[tuple[float, ...], bool] = {}

    def whole(self) -> Piece:
        """Return the whole surface as one piece."""
        points = self._triangles.reshape(-1, 3)
        # No corner of its box is inside: S does not extend beyond the extremes of its surface.
        return Piece(
            points.min(axis=0), points.max(axis=0), self._triangles, np.zeros((0, 3)), self._triangles
        )

    def cut(self, piece: Piece, axis: int, at: float) -> tuple[Piece, Piece]:
        """Return the parts of a piece below and above a plane across an axis; points in it are in both.

        Raises:
            ValueError: The plane does not meet the box of the piece.
        """
        if not piece.low[axis] <= at <= piece.high[axis]:
            raise ValueError(
                f"a cut at {at} does not meet a piece from {piece.low[axis]} to {piece.high[axis]}"
            )
        below, above = split(piece.triangles, axis, at)
        columns = (piece.column, piece.column) if axis == 2 else split(piece.column, axis, at)
        high, low = piece.high.copy(), piece.low.copy()
        high[axis] = low[axis] = at
        return (
            Piece(piece.low, high, below, self._inner(piece.low, high), columns[0]),
            Piece(low, piece.high, above, self._inner(low, piece.high), columns[1]),
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
    """Return the parts of triangles (n, 3, 3) below and above a plane across an axis, as triangles.

    Each triangle is the union of its parts; points in the plane belong to both.
    """
    height = triangles[:, :, axis] - at
    under, over = np.all(height <= 0.0, axis=1), np.all(height >= 0.0, axis=1)
    across = ~under & ~over
    lone, rest = _across(triangles[across], height[across], axis, at)
    up = (height[across] > 0.0).sum(axis=1) == 1  # the single corner on its side is above
    below = [triangles[under], lone[~up], *(part[up] for part in rest)]
    above = [triangles[over], lone[up], *(part[~up] for part in rest)]
    return np.concatenate(below), np.concatenate(above)


def _across(triangles: Array, height: Array, axis: int, at: float) -> tuple[Array, tuple[Array, Array]]:
    """Cut triangles with corners on both sides.

    Returns:
        The part with one corner, and the other part as two triangles.
    """
    positive = height > 0.0
    alone = np.where((positive.sum(axis=1) == 1)[:, None], positive, ~positive)
    turn = (np.argmax(alone, axis=1)[:, None] + np.arange(3)) % 3
    row = np.arange(len(triangles))[:, None]
    (a, b, c), (ha, hb, hc) = np.moveaxis(triangles[row, turn], 1, 0), height[row, turn].T
    p, q = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
    p[:, axis] = q[:, axis] = at
    return np.stack([a, p, q], axis=1), (np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1))


def proven_outside(point: Array, triangles: Array, rays: Array) -> bool:
    """Return True if one of the rays from a point is proven to miss all triangles, so they do not enclose it.

    A ray meets the plane of a triangle at the distance t and the coordinates x, y along two of its edges
    (Möller and Trumbore, 1997). It misses the triangle if x < 0, y < 0, x + y > 1 or t < 0, each by a margin
    for rounding.
    """
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
    """Return evenly spread directions (Fibonacci sphere), (count, 3), none of them along an axis."""
    k = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * k / count, k * np.pi * (3.0 - np.sqrt(5.0))
    level = np.sqrt(1.0 - z * z)
    return np.stack([level * np.cos(angle), level * np.sin(angle), z], axis=1)
