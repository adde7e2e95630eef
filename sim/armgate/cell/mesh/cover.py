"""Proof that convex hulls together contain a surface, and by how much they fall short of it.

Every triangle is cut by the planes of the hulls that it meets: what lies inside a hull is done, what is
left over after all hulls are polygons that no hull contains. These are cut once more, by planes moved outward
by ``reach``, so that a sliver along the borders of several hulls falls into pieces of one hull each. The
distance to a convex body is a convex function, so a polygon whose corners are all within r of *one* hull lies
within r of that hull, with all its points. Hence

    shortfall = max over polygons left of (min over hulls of (max over corners of the distance))

is a bound for all points of the surface, not for samples: hulls thickened by it contain the surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.mesh.hull import Array, Hull

SLACK = 1e-12
"""How far out of a plane counts as inside, m: rounding."""

_REACH = 1e-9
_BLOCK = 1 << 20


@dataclass(frozen=True, eq=False)
class Gap:
    """A piece of the surface that no hull contains.

    Attributes:
        polygon: Its corners, (k, 3), m.
        hull: Index of the hull that is nearest to all of it.
        distance: Of its farthest corner from that hull, m.
    """

    polygon: Array
    hull: int
    distance: float


def gaps(triangles: Array, hulls: Sequence[Hull], reach: float = _REACH) -> list[Gap]:
    """All that the hulls together leave out of a surface of triangles (n, 3, 3), m."""
    found = []
    contained, meets = _sorted_out(triangles, hulls)
    for i in np.flatnonzero(~contained):
        left = [triangles[i]]
        for k in map(int, np.flatnonzero(meets[i])):
            left = [piece for polygon in left for piece in _outside(polygon, hulls[k], 0.0)[0]]
        found += [gap for polygon in left for gap in _attributed(polygon, hulls, reach)]
    return found


def shortfall(triangles: Array, hulls: Sequence[Hull]) -> float:
    """By how much hulls must be thickened to contain a surface of triangles (n, 3, 3), m."""
    return max((gap.distance for gap in gaps(triangles, hulls)), default=0.0)


def _sorted_out(triangles: Array, hulls: Sequence[Hull]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which triangles one hull contains as a whole, (n,); which hulls each may meet at all, (n, hulls)."""
    meets = np.zeros((len(triangles), len(hulls)), dtype=np.bool_)
    contained = np.zeros(len(triangles), dtype=np.bool_)
    for k, hull in enumerate(hulls):
        block = max(1, _BLOCK // (3 * len(hull.offsets)))
        for start in range(0, len(triangles), block):
            part = slice(start, start + block)
            heights = triangles[part] @ hull.normals.T + hull.offsets
            contained[part] |= heights.max(axis=(1, 2)) <= SLACK
            meets[part, k] = np.all(heights.min(axis=1) <= SLACK, axis=1)
    return contained, meets


def _attributed(polygon: Array, hulls: Sequence[Hull], reach: float) -> list[Gap]:
    """The pieces of a polygon outside of all hulls, each with the hull that is nearest to all of it."""
    found, left = [], [polygon]
    for k, hull in enumerate(hulls):
        pieces = [_outside(part, hull, reach) for part in left]
        left = [piece for outer, _ in pieces for piece in outer]
        near = [inner for _, inner in pieces if len(inner)]
        found += [Gap(inner, k, float(hull.distance(inner).max())) for inner in near]
    return found + [_nearest(part, hulls) for part in left]


def _nearest(polygon: Array, hulls: Sequence[Hull]) -> Gap:
    distances = [float(hull.distance(polygon).max()) for hull in hulls]
    nearest = int(np.argmin(distances))
    return Gap(polygon, nearest, distances[nearest])


def _outside(polygon: Array, hull: Hull, reach: float) -> tuple[list[Array], Array]:
    """Cuts a polygon by a hull's planes, moved outward by ``reach``: outer pieces, and the inner one."""
    heights = polygon @ hull.normals.T + (hull.offsets - reach)
    if np.any(heights.min(axis=0) > SLACK):
        return [polygon], _NOTHING
    pieces, inner = [], polygon
    for plane in np.flatnonzero(heights.max(axis=0) > SLACK):
        height = inner @ hull.normals[plane] + (hull.offsets[plane] - reach)
        if height.max() > SLACK:
            pieces.append(_clip(inner, height))
            inner = _clip(inner, -height)
            if len(inner) == 0:
                return [polygon], _NOTHING  # they do not meet
    return pieces, inner


_NOTHING: Array = np.zeros((0, 3))


def _clip(polygon: Array, height: Array) -> Array:
    """The part of a convex polygon where the height (given at its corners) is not negative."""
    kept: list[Array] = []
    for i in range(len(polygon)):
        here, there = height[i - 1], height[i]
        if (here < 0.0) != (there < 0.0):
            share = here / (here - there)
            kept.append(polygon[i - 1] + share * (polygon[i] - polygon[i - 1]))
        if there >= 0.0:
            kept.append(polygon[i])
    return np.array(kept).reshape(-1, 3)
