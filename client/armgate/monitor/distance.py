"""Signed distances of convex solids, with certified lower and upper bounds.

Lower bound: for any unit vector n, the planes with normal n that support both solids leave the room
D(n) = −h_A(n) − h_B(−n), and the signed distance is the largest D over all n. So each D(n) is a lower bound.
Upper bound: the distance of two points, one inside each solid, is at least that of the solids.

GJK (Gilbert, Johnson, Keerthi 1988) finds both at once: the point v of the difference A − B nearest to the
origin, which is a convex combination of support points, and n = −v/|v|. It works on the cores, which are the
solids without their thickness; the thicknesses are subtracted at the end. If the cores overlap, the best n is
searched for directly, and the upper bound only shows that they overlap.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.convex_solid import Solid

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GAP = 1e-7
"""Bounds that differ by less than this count as equal, m."""

ROUNDING = 1e-9
"""Rounding allowance, subtracted from lower bounds and added to upper ones, m."""

_STEPS = 64
_OVERLAP = 1e-10
_ALONG = 1e-13
"""For a direction closer to the axis of a disc than this, the centre replaces the rim point, rad."""


@dataclass(frozen=True, slots=True)
class DistanceBounds:
    """Bounds of the signed distance [m], and the unit vector from the first solid to the second."""

    low: float
    high: float
    normal: Vector


class PlacedSolid:
    """Solid at a placement in the world, prepared for support queries."""

    __slots__ = ("_axis", "_cloud", "_discs", "_points", "radius", "solid", "where")

    def __init__(self, solid: Solid, where: Array) -> None:
        self.solid, self.where, self.radius = solid, where, solid.radius
        self._cloud = solid.points @ where[:3, :3].T + where[:3, 3]
        self._points: list[list[float]] | None = self._cloud.tolist() if len(self._cloud) <= 16 else None
        self._discs: list[float] | None = solid.discs.tolist() if solid.discs.any() else None
        self._axis: list[float] = where[:3, 2].tolist()

    @property
    def children(self) -> "list[PlacedSolid]":
        """The solids inside, at the same placement."""
        return [PlacedSolid(child, self.where) for child in self.solid.children]

    @property
    def middle(self) -> Array:
        """Middle of the solid in the world, m."""
        return np.asarray(self.where[:3, :3] @ self.solid.middle + self.where[:3, 3])

    def support(self, x: float, y: float, z: float) -> Vector:
        """Return the farthest point of the core along a direction."""
        if self._points is None:
            px, py, pz = self._cloud[int((self._cloud @ (x, y, z)).argmax())].tolist()
            return px, py, pz
        if self._discs is None:
            a, b, c = max(self._points, key=lambda p: p[0] * x + p[1] * y + p[2] * z)
            return a, b, c
        return self._rim(self._points, self._discs, (x, y, z))

    def _rim(self, points: list[list[float]], discs: list[float], d: Vector) -> Vector:
        x, y, z = d
        a, b, c = self._axis
        along = x * a + y * b + z * c
        u, v, w = x - along * a, y - along * b, z - along * c
        # The rounding error of the subtraction above, which is large for an axial direction.
        again = u * a + v * b + w * c
        u, v, w = u - again * a, v - again * b, w - again * c
        across = math.sqrt(u * u + v * v + w * w)
        best, found = -math.inf, (0.0, 0.0, 0.0)
        for p, radius in zip(points, discs, strict=True):
            far = p[0] * x + p[1] * y + p[2] * z + radius * across
            if far > best:
                share = radius / across if across > _ALONG else 0.0
                best, found = far, (p[0] + share * u, p[1] + share * v, p[2] + share * w)
        return found

    def heights(self, normals: Array) -> Array:
        """Return the support function of the core in directions (k, 3), (k,)."""
        along = normals @ self.where[:3, 2]
        squares = np.einsum("ki,ki->k", normals, normals) - along * along
        across = np.sqrt(np.maximum(squares, 0.0))
        far = normals @ self._cloud.T + across[:, None] * self.solid.discs
        return np.asarray(far.max(axis=1))


def distance_bounds(
    a: PlacedSolid, b: PlacedSolid, enough: float = math.inf, toward: Vector | None = None
) -> DistanceBounds:
    """Return bounds of the signed distance of two solids; ``toward`` is a guess of the normal.

    Boxes around solids are opened only if their distance is less than ``enough`` [m]; else the lower bound is
    that of the boxes, and the upper bound is infinite.
    """
    found = _convex(a, b, toward)
    inside_a, inside_b = a.children, b.children
    if not inside_a and not inside_b:
        return found
    if found.low >= enough:
        return DistanceBounds(found.low, math.inf, found.normal)
    open_a = bool(inside_a) and (not inside_b or a.solid.extent >= b.solid.extent)
    parts = [(child, b) for child in inside_a] if open_a else [(a, child) for child in inside_b]
    low, high, normal = math.inf, math.inf, found.normal
    for first, second in parts:
        one = distance_bounds(first, second, min(enough, high))
        high = min(high, one.high)
        if one.low < low:
            low, normal = one.low, one.normal
    return DistanceBounds(max(low, found.low), high, normal)


def _convex(a: PlacedSolid, b: PlacedSolid, toward: Vector | None) -> DistanceBounds:
    """Bound the signed distance of two convex solids by GJK."""
    thick = a.radius + b.radius
    simplex = [_difference(a, b, *(toward or (b.middle - a.middle).tolist()))]
    v, length = simplex[0], 0.0
    low, normal = -math.inf, (0.0, 0.0, 1.0)
    for _ in range(_STEPS):
        length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if length < _OVERLAP:
            break
        n = (-v[0] / length, -v[1] / length, -v[2] / length)
        w = _difference(a, b, *n)
        bound = -(w[0] * n[0] + w[1] * n[1] + w[2] * n[2])
        if bound > low:
            low, normal = bound, n
        if length - low < GAP or w in simplex:
            break
        simplex, new = _nearest([*simplex, w])
        if len(simplex) == 4 and low <= 0.0:
            length = 0.0
            break
        if _square(new) >= length * length:
            break
        v = new
    if length < _OVERLAP:
        return _overlapping(a, b, thick, normal)
    return DistanceBounds(low - thick - ROUNDING, length - thick + ROUNDING, normal)


def _difference(a: PlacedSolid, b: PlacedSolid, x: float, y: float, z: float) -> Vector:
    """Return the point of A − B that is farthest along a direction."""
    p, q = a.support(x, y, z), b.support(-x, -y, -z)
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


def _square(v: Vector) -> float:
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


# --- the point of a simplex nearest to the origin (after Ericson, Real-Time Collision Detection, 2005) -----

Simplex = list[Vector]


def _nearest(simplex: Simplex) -> tuple[Simplex, Vector]:
    """Return the smallest face that contains the nearest point, and the point; 4 corners mean inside."""
    if len(simplex) == 2:
        return _on_segment(simplex[0], simplex[1])
    if len(simplex) == 3:
        return _on_triangle(simplex[0], simplex[1], simplex[2])
    return _in_tetrahedron(simplex)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _along(a: Vector, d: Vector, t: float) -> Vector:
    return a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]


def _on_segment(a: Vector, b: Vector) -> tuple[Simplex, Vector]:
    d = _minus(b, a)
    t, square = -_dot(a, d), _dot(d, d)
    if t <= 0.0:
        return [a], a
    return ([b], b) if t >= square else ([a, b], _along(a, d, t / square))


def _on_triangle(a: Vector, b: Vector, c: Vector) -> tuple[Simplex, Vector]:
    ab, ac = _minus(b, a), _minus(c, a)
    d1, d2 = -_dot(ab, a), -_dot(ac, a)
    d3, d4 = -_dot(ab, b), -_dot(ac, b)
    d5, d6 = -_dot(ab, c), -_dot(ac, c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    if va > 0.0 and vb > 0.0 and vc > 0.0 and total > 0.0:
        v, w = vb / total, vc / total
        return [a, b, c], _along(_along(a, ab, v), ac, w)
    edges = (_on_segment(a, b), _on_segment(b, c), _on_segment(a, c))
    return min(edges, key=lambda found: _square(found[1]))


def _in_tetrahedron(simplex: Simplex) -> tuple[Simplex, Vector]:
    a, b, c, d = simplex
    best: tuple[Simplex, Vector] | None = None
    for p, q, r, other in ((a, b, c, d), (a, c, d, b), (a, b, d, c), (b, c, d, a)):
        normal = _cross(_minus(q, p), _minus(r, p))
        mine, theirs = -_dot(normal, p), _dot(normal, _minus(other, p))
        if mine * theirs < 0.0 or abs(theirs) < 1e-14 * _square(normal) ** 0.5:
            found = _on_triangle(p, q, r)
            if best is None or _square(found[1]) < _square(best[1]):
                best = found
    return (simplex, (0.0, 0.0, 0.0)) if best is None else best


# --- overlapping solids ------------------------------------------------------------------------------------


def _overlapping(a: PlacedSolid, b: PlacedSolid, thick: float, normal: Vector) -> DistanceBounds:
    """Search for the plane that leaves the most room; the room is negative, because the cores overlap."""
    low, n = deepest(a, b, normal)
    return DistanceBounds(low - thick - ROUNDING, max(low, 0.0) - thick, n)


def deepest(a: PlacedSolid, b: PlacedSolid, normal: Vector) -> tuple[float, Vector]:
    """Return the largest room between the cores and its normal, by turning many planes step by step."""
    tries = [normal, *a.where[:3, :3].T, *b.where[:3, :3].T, b.middle - a.middle]
    tries += [np.cross(p, q) for p in a.where[:3, :3].T for q in b.where[:3, :3].T]
    n = np.array(tries, dtype=np.float64)
    lengths = np.linalg.norm(n, axis=1)
    n = n[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    n = np.concatenate([n, -n])
    best, step = _room(a, b, n), np.full(len(n), 0.3)
    turns = np.concatenate([np.eye(3), -np.eye(3)])
    for _ in range(80):
        tried = n[:, None, :] + step[:, None, None] * turns
        tried /= np.linalg.norm(tried, axis=2, keepdims=True)
        rooms = _room(a, b, tried.reshape(-1, 3)).reshape(len(n), -1)
        k = rooms.argmax(axis=1)
        rows = np.arange(len(n))
        up = rooms[rows, k] > best
        n = np.where(up[:, None], tried[rows, k], n)
        best, step = np.where(up, rooms[rows, k], best), np.where(up, step, step / 2.0)
        if step.max() < 1e-9:
            break
    x, y, z = n[int(best.argmax())].tolist()
    return float(best.max()), (x, y, z)


def _room(a: PlacedSolid, b: PlacedSolid, normals: Array) -> Array:
    return -a.heights(normals) - b.heights(-normals)
