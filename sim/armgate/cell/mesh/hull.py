"""Convex hulls with corners, faces and planes (qhull through coal), and distances of points to them.

coal accepts no corner with more than 255 neighbours, as on a fine disk: hulls of many points are thinned.

qhull joggles the points (option QJ) by less than ``JOGGLE`` of their extent, always in the same way. The
alternative, merging nearly coplanar facets (option Qt), crashes the process in coal 3.0 if points are
coplanar up to rounding, such as the corners of a rotated box that was cut.
"""

from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.shapes import is_solid

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_SHARE = 8
"""Present corners for each corner that one round adds: more at once would add neighbours of each other."""

QHULL = "QJ"
"""Options of qhull: joggle, see above."""

JOGGLE = 1e-9
"""Largest error of the planes, as a share of the extent of the points."""

_BLOCK = 1 << 18
"""Largest number of distances from points to faces or points that are computed at once; bounds memory."""


@dataclass(frozen=True, eq=False)
class Hull:
    """Convex hull.

    Attributes:
        vertices: Corners, (v, 3), m.
        faces: Triangles as indices of corners, (f, 3), in either winding.
        normals: Outward unit normals of the planes, (p, 3).
        offsets: Offsets of the planes, (p,): a point x is inside if normals·x + offsets ≤ 0.
    """

    vertices: Array
    faces: Index
    normals: Array
    offsets: Array

    def height(self, points: Array) -> Array:
        """Return the heights of points (k, 3) above the planes, (k,): lower bounds of their distances, m."""
        block = max(1, _BLOCK // len(self.offsets))
        parts = [points[i : i + block] for i in range(0, len(points), block)]
        heights = [(part @ self.normals.T + self.offsets).max(axis=1) for part in parts]
        return np.concatenate([*heights, np.zeros(0)])

    def distance(self, points: Array) -> Array:
        """Return the distances of points (k, 3) to the hull, (k,), m; 0 inside."""
        distances = np.zeros(len(points))
        outside = np.flatnonzero(self.height(points) > 0.0)
        block = max(1, _BLOCK // len(self.faces))
        for start in range(0, len(outside), block):
            some = outside[start : start + block]
            distances[some] = _to_triangles(points[some], self.vertices[self.faces])
        return distances


def hull_of(points: Array) -> Hull:
    """Return the convex hull of points (k, 3), m.

    Raises:
        ModelError: The points are flat: their hull has no inside.
    """
    if not is_solid(points):  # qhull within coal crashes on flat input
        raise ModelError("the points lie in a plane; expected a body that has an inside")
    middle = points.mean(axis=0)
    given = coal.StdVec_Vec3s()
    for point in points - middle:
        given.append(point)
    try:
        convex = coal.Convex.convexHull(given, True, QHULL)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"qhull cannot make a convex hull: {error}") from error
    polygons = (convex.polygons(i) for i in range(convex.num_polygons))
    faces = np.array([[polygon[0], polygon[1], polygon[2]] for polygon in polygons], dtype=np.intp)
    normals = np.array(convex.normals())
    corners = _unjoggled(np.array(convex.points()) + middle, points)
    return Hull(corners, faces, normals, np.array(convex.offsets()) - normals @ middle)


def _unjoggled(corners: Array, points: Array) -> Array:
    """Return the point nearest to each joggled corner."""
    block = max(1, _BLOCK // len(points))
    parts = [corners[i : i + block] for i in range(0, len(corners), block)]
    nearest = [((part[:, None] - points) ** 2).sum(axis=2).argmin(axis=1) for part in parts]
    return np.asarray(points[np.concatenate(nearest)])


def thinned(points: Array, most: int) -> tuple[Hull, float]:
    """Return the hull of at most ``most`` of the points (k, 3), and a bound of all points' distance to it, m.

    The hull of all points lies within that distance of the thinned one: the distance to a convex body is a
    convex function, so it is largest at a corner. The thinned hull starts with the extreme points along 26
    directions; then the points farthest outside are added, a few at a time. Points that are outside by less
    than the joggle are left out.

    Raises:
        ModelError: The points are flat: their hull has no inside.
    """
    kept = _extreme(points)
    thin = hull_of(points[kept])
    left, least = np.arange(len(points)), JOGGLE * float(np.ptp(points, axis=0).max())
    while True:
        heights = thin.height(points[left])
        left, heights = left[heights > 0.0], heights[heights > 0.0]  # points inside stay inside
        out = left[np.argsort(-heights, kind="stable")][: np.count_nonzero(heights > least)]
        out = out[: min(most - len(kept), max(1, len(kept) // _SHARE))]
        if len(out) == 0:
            break
        kept += out.tolist()
        thin = hull_of(points[kept])
    return thin, float(thin.distance(points[left]).max(initial=0.0)) + least


def _extreme(points: Array) -> list[int]:
    """Return the indices of the extreme points in 26 directions, relative to the principal axes.

    The directions point to the middles of the faces and edges, and to the corners, of a cube.

    Both ends of all three principal axes come first, so the points found are not flat if ``points`` are not.
    """
    middle = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(middle.T @ middle)
    grid = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    directions = sorted((d for d in grid.tolist() if any(d)), key=lambda d: sum(map(abs, d)))
    along = middle @ axes @ np.array(directions).T
    # Take the extreme point farthest from the middle: it is a corner, not inside a face or an edge.
    level = along >= along.max(axis=0) - JOGGLE * float(np.ptp(points, axis=0).max())
    farthest = np.where(level, np.linalg.norm(middle, axis=1)[:, None], -1.0).argmax(axis=0)
    return list(dict.fromkeys(map(int, farthest)))


# --- distance of points to triangles -----------------------------------------------------------------------


def _to_triangles(points: Array, triangles: Array) -> Array:
    """Return distances of points (k, 3) to the nearest of triangles (f, 3, 3), (k,), m.

    The nearest point of a triangle is on an edge, or is the foot of the perpendicular if that is inside.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    edges = [_to_segments(points, p, q) for p, q in ((a, b), (b, c), (c, a))]
    squares = np.minimum.reduce([*edges, _to_planes(points, a, b - a, c - a)])
    distances: Array = np.sqrt(squares.min(axis=1))
    return distances


def _to_segments(points: Array, start: Array, end: Array) -> Array:
    """Return squared distances of points (k, 3) to segments from (f, 3) to (f, 3), (k, f), m²."""
    along = end - start
    length = np.maximum(np.einsum("fi,fi->f", along, along), 1e-300)
    away = points[:, None] - start
    share = np.clip(np.einsum("kfi,fi->kf", away, along) / length, 0.0, 1.0)
    away = away - share[:, :, None] * along
    squares: Array = np.einsum("kfi,kfi->kf", away, away)
    return squares


def _to_planes(points: Array, corner: Array, u: Array, v: Array) -> Array:
    """Return squared distances along the normal, (k, f), m²; infinite if the foot is outside the triangle."""
    normal = np.cross(u, v)
    area = np.einsum("fi,fi->f", normal, normal)
    good = area > 1e-24 * np.einsum("fi,fi->f", u, u) * np.einsum("fi,fi->f", v, v) + 1e-300
    safe = np.where(good, area, 1.0)
    away = points[:, None] - corner
    s = np.einsum("kfi,fi->kf", away, np.cross(v, normal)) / safe
    t = np.einsum("kfi,fi->kf", away, np.cross(normal, u)) / safe
    inside = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & good
    squares: Array = np.where(inside, np.einsum("kfi,fi->kf", away, normal) ** 2 / safe, np.inf)
    return squares
