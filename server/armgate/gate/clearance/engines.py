"""Distance engines: they suggest a direction; the support functions prove the distance.

coal (the engine inside pin) comes first, with its tolerance set to 1e-8: at its default it errs by up to
0.6 mm. python-fcl, another implementation, is queried if the proven bound is below coal's distance. In
measurements python-fcl alone over-reported distances of cylinders by up to 43 mm: no engine is ever trusted.

Both engines receive a convex body's hull without its radius, which is subtracted afterwards: separate hulls
still have a direction when the bodies around them touch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import isfinite, sqrt
from types import ModuleType
from typing import Any, Protocol, assert_never

import coal
import fcl
import numpy as np
from numpy.typing import NDArray

from armgate.cell.mesh.hull import QHULL, hull_of
from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Shape, Sphere

Array = NDArray[np.float64]
_TOLERANCE = 1e-8
TOUCHING = 1e-9
"""Distance up to which the witness points give no direction, m."""


@dataclass(frozen=True, slots=True)
class Suggestion:
    """Result of an engine: signed distance, unit direction from a to b, witness points (world)."""

    distance: float
    normal: Array
    points: tuple[Array, Array]


class Engine(Protocol):
    """Distance engine: suggests the direction in which two bodies are farthest apart."""

    def suggest(self, a: int, pose_a: tuple[Array, Array], b: int, pose_b: tuple[Array, Array]) -> Suggestion:
        """Query bodies ``a`` and ``b`` (indices) at poses (R, t) in one common frame."""


@cache
def _settle_coal() -> None:
    """Query coal once, always with the same bodies.

    The last digits of all its results depend on the first query of a process: on whether the bodies of that
    query are rotated against each other. Without this, a run would depend on the runs before it in its
    process.
    """
    box, here, there = coal.Box(1.0, 1.0, 1.0), coal.Transform3s(), coal.Transform3s()
    there.setTranslation(np.array([3.0, 0.0, 0.0]))
    coal.distance(box, here, box, there, coal.DistanceRequest(), coal.DistanceResult())


class CoalEngine:
    """coal with GJK and EPA tolerance 1e-8; its distance is signed for overlapping bodies."""

    def __init__(self, shapes: tuple[Shape, ...]) -> None:
        _settle_coal()
        self._given = shapes
        self._shapes = [_engine_shape(coal, s, _coal_hull) for s in shapes]
        self._radii = radii_of(shapes)
        self._request = coal.DistanceRequest()
        self._request.gjk_tolerance = _TOLERANCE
        self._request.epa_tolerance = _TOLERANCE
        self._result = coal.DistanceResult()
        self._places = coal.Transform3s(), coal.Transform3s()

    def __reduce__(self) -> tuple[type["CoalEngine"], tuple[tuple[Shape, ...]]]:
        """Return the constructor and its argument: the engine's objects are made anew in a copy."""
        return CoalEngine, (self._given,)

    def suggest(self, a: int, pose_a: tuple[Array, Array], b: int, pose_b: tuple[Array, Array]) -> Suggestion:
        """Query coal; its normal is used if the bodies touch, because the points then give no direction."""
        d, p, q, normal = self.query(a, pose_a, b, pose_b)
        p, q = p.copy(), q.copy()
        found = Suggestion(d, _direction(p, q, d, normal), (p, q))
        return _thickened(found, self._radii[a], self._radii[b])

    def query(
        self, a: int, pose_a: tuple[Array, Array], b: int, pose_b: tuple[Array, Array]
    ) -> tuple[float, Array, Array, Array]:
        """Return coal's distance, witness points and normal for the bodies without their radii.

        The arrays are valid until the next query.
        """
        result, (place_a, place_b) = self._result, self._places
        result.clear()
        place_a.setRotation(pose_a[0])
        place_a.setTranslation(pose_a[1])
        place_b.setRotation(pose_b[0])
        place_b.setTranslation(pose_b[1])
        d = coal.distance(self._shapes[a], place_a, self._shapes[b], place_b, self._request, result)
        return d, result.getNearestPoint1(), result.getNearestPoint2(), result.normal


class FclEngine:
    """python-fcl: second engine, for separated bodies; its distance is unsigned."""

    def __init__(self, shapes: tuple[Shape, ...]) -> None:
        self._given = shapes
        self._shapes = [_engine_shape(fcl, s, _fcl_hull) for s in shapes]
        self._radii = radii_of(shapes)

    def __reduce__(self) -> tuple[type["FclEngine"], tuple[tuple[Shape, ...]]]:
        """Return the constructor and its argument: the engine's objects are made anew in a copy."""
        return FclEngine, (self._given,)

    def suggest(self, a: int, pose_a: tuple[Array, Array], b: int, pose_b: tuple[Array, Array]) -> Suggestion:
        """Query python-fcl with a fresh result: a reused one keeps the old minimum."""
        result = fcl.DistanceResult()
        one = fcl.CollisionObject(self._shapes[a], fcl.Transform(*pose_a))
        two = fcl.CollisionObject(self._shapes[b], fcl.Transform(*pose_b))
        d = float(fcl.distance(one, two, fcl.DistanceRequest(enable_nearest_points=True), result))
        p, q = (np.asarray(x, dtype=np.float64) for x in result.nearest_points)
        found = Suggestion(d, _direction(p, q, d, pose_b[1] - pose_a[1]), (p, q))
        return _thickened(found, self._radii[a], self._radii[b])


def _direction(p: Array, q: Array, distance: float, fallback: Array) -> Array:
    """Return the unit direction from p to q; the compiled form is in ``kernels.certify``."""
    v = q - p if distance > TOUCHING else np.array(fallback, dtype=np.float64)
    length = sqrt(float(v @ v))
    if not isfinite(length) or length < TOUCHING:
        return np.array([0.0, 0.0, 1.0])
    return np.asarray(v / length)


def radii_of(shapes: Sequence[Shape]) -> list[float]:
    """Return the thickness of each body around the hull that the engines receive, m."""
    return [shape.radius if isinstance(shape, Convex) else 0.0 for shape in shapes]


def _thickened(found: Suggestion, radius_a: float, radius_b: float) -> Suggestion:
    if radius_a == radius_b == 0.0:
        return found
    n, (p, q) = found.normal, found.points
    return Suggestion(found.distance - radius_a - radius_b, n, (p + radius_a * n, q - radius_b * n))


def _engine_shape(engine: ModuleType, shape: Shape, hull: Callable[[Convex], Any]) -> Any:
    """Return the engine's object for a shape; both engines name primitives and their arguments alike."""
    match shape:
        case Sphere(radius=r):
            return engine.Sphere(r)
        case Capsule(radius=r, length=length):
            return engine.Capsule(r, length)
        case Cylinder(radius=r, length=length):
            return engine.Cylinder(r, length)
        case Box(x=x, y=y, z=z):
            return engine.Box(x, y, z)
        case Cone(radius=r, length=length):
            return engine.Cone(r, length)
        case Convex():
            return hull(shape)
        case _:
            assert_never(shape)


def _coal_hull(shape: Convex) -> Any:
    points = coal.StdVec_Vec3s()
    for vertex in shape.vertices:
        points.append(np.array(vertex))
    return coal.Convex.convexHull(points, True, QHULL)


def _fcl_hull(shape: Convex) -> Any:
    hull = hull_of(np.array(shape.vertices))
    faces = np.column_stack([np.full(len(hull.faces), 3), hull.faces])
    return fcl.Convex(np.ascontiguousarray(hull.vertices), len(hull.faces), faces.ravel())
