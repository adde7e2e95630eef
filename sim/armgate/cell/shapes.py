"""Shapes of bodies: convex, centred in their frame, with their axis along z; all sizes in m.

Primitives are given by a few sizes; a ``Convex`` shape, such as a part of a mesh, is given by its corners.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.errors import ModelError

Kind = Literal["sphere", "capsule", "cylinder", "box", "cone", "convex"]
Points = tuple[tuple[float, float, float], ...]

MAX_EXTENT = 1e3
"""Largest size or coordinate of a cell, m."""

THINNEST = 1e-6
"""Smallest thickness of a convex body, m; it must also be at least 1e-5 of its extent."""

MAX_CORNERS = 4096
"""Largest number of points of a convex body: its hull takes time and memory."""

_RIM = 16
"""Number of corners of the polygon that contains the rim of a cone."""


class Primitive:
    """Base of all shapes.

    Attributes:
        kind: Name of the shape in the configuration and on the wire.
    """

    __slots__ = ()
    kind: ClassVar[Kind]

    def __post_init__(self) -> None:
        for size in self.size:
            if not 0.0 < size <= MAX_EXTENT:
                raise ModelError(
                    f"a {self.kind} cannot have the size {size}; expected a positive number of metres, at "
                    f"most {MAX_EXTENT:g}"
                )

    @property
    def size(self) -> tuple[float, ...]:
        """Sizes in the order of the configuration and the wire, m."""
        return tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball around the centre that contains the shape, m."""
        raise NotImplementedError

    @property
    def core(self) -> Points:
        """Points whose convex hull, thickened by ``core_radius``, contains the shape.

        It equals the shape, except for a cylinder, which is contained in the capsule of its ends, and a cone,
        which is contained in a pyramid.
        """
        raise NotImplementedError

    @property
    def core_radius(self) -> float:
        """Thickness added around the core, m."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Sphere(Primitive):
    """All points within ``radius`` of the centre."""

    kind: ClassVar[Literal["sphere"]] = "sphere"
    radius: float

    @property
    def bounding_radius(self) -> float:
        """Radius, m."""
        return self.radius

    @property
    def core(self) -> Points:
        """Centre."""
        return ((0.0, 0.0, 0.0),)

    @property
    def core_radius(self) -> float:
        """Radius, m."""
        return self.radius


class _Round(Primitive):
    """Shape around a segment along z."""

    __slots__ = ()
    radius: float
    length: float

    @property
    def core(self) -> Points:
        """Both ends of the segment."""
        return ((0.0, 0.0, -self.length / 2), (0.0, 0.0, self.length / 2))

    @property
    def core_radius(self) -> float:
        """Radius, m."""
        return self.radius


@dataclass(frozen=True, slots=True)
class Capsule(_Round):
    """All points within ``radius`` of a segment of ``length`` along z (the length excludes the caps)."""

    kind: ClassVar[Literal["capsule"]] = "capsule"
    radius: float
    length: float

    @property
    def bounding_radius(self) -> float:
        """Half the segment and one cap, m."""
        return self.length / 2 + self.radius


@dataclass(frozen=True, slots=True)
class Cylinder(_Round):
    """Flat-ended cylinder around z."""

    kind: ClassVar[Literal["cylinder"]] = "cylinder"
    radius: float
    length: float

    @property
    def bounding_radius(self) -> float:
        """Distance from the centre to a rim, m."""
        return math.hypot(self.length / 2, self.radius)


@dataclass(frozen=True, slots=True)
class Box(Primitive):
    """Box with full edge lengths ``x``, ``y``, ``z``."""

    kind: ClassVar[Literal["box"]] = "box"
    x: float
    y: float
    z: float

    @property
    def bounding_radius(self) -> float:
        """Half the diagonal, m."""
        return math.hypot(self.x, self.y, self.z) / 2

    @property
    def core(self) -> Points:
        """Eight corners."""
        xs, ys, zs = ((-edge / 2, edge / 2) for edge in self.size)
        return tuple(product(xs, ys, zs))

    @property
    def core_radius(self) -> float:
        """Zero: the core is the shape."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Cone(Primitive):
    """Cone around z, with its base of ``radius`` at −length/2 and its tip at +length/2."""

    kind: ClassVar[Literal["cone"]] = "cone"
    radius: float
    length: float

    @property
    def bounding_radius(self) -> float:
        """Distance from the centre to the rim, m."""
        return math.hypot(self.length / 2, self.radius)

    @property
    def core(self) -> Points:
        """Tip, and corners of a polygon around the base."""
        out, turn = self.radius / math.cos(math.pi / _RIM), 2 * math.pi / _RIM
        rim = ((out * math.cos(i * turn), out * math.sin(i * turn), -self.length / 2) for i in range(_RIM))
        return ((0.0, 0.0, self.length / 2), *rim)

    @property
    def core_radius(self) -> float:
        """Zero: the core is the shape."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Convex(Primitive):
    """All points within ``radius`` of the convex hull of ``vertices``, which need not be its corners.

    An origin in the middle gives the tightest motion bounds, see ``centred``.
    """

    kind: ClassVar[Literal["convex"]] = "convex"
    vertices: Points
    radius: float = 0.0

    def __post_init__(self) -> None:
        points = np.array(self.vertices, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
            raise ModelError(f"{len(self.vertices)} corners of a convex body; expected 4 points or more")
        if len(points) > MAX_CORNERS:
            raise ModelError(f"{len(points)} corners of a convex body; expected at most {MAX_CORNERS}")
        if not (np.all(np.isfinite(points)) and math.isfinite(self.radius) and self.radius >= 0.0):
            raise ModelError("a corner or the radius of a convex body is not a finite number of metres")
        if np.abs(points).max() > MAX_EXTENT or self.radius > MAX_EXTENT:
            raise ModelError(f"a convex body extends beyond {MAX_EXTENT:g} m; expected a smaller one")
        if not is_solid(self.vertices):
            raise ModelError(
                f"a convex body is flat; expected it at least {THINNEST:g} m and 1e-5 of its extent thick"
            )

    @classmethod
    def centred(
        cls, vertices: Sequence[Sequence[float]], radius: float = 0.0
    ) -> "tuple[Convex, tuple[float, float, float]]":
        """Return a convex body with its frame in the middle of its axis-aligned box, and that middle, m."""
        points = np.array(vertices, dtype=np.float64)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        x, y, z = middle.tolist()
        return cls(tuple((a, b, c) for a, b, c in (points - middle).tolist()), radius), (x, y, z)

    @property
    def size(self) -> tuple[float, ...]:
        """Empty: a convex body has corners instead of sizes."""
        return ()

    @property
    def half_sides(self) -> tuple[float, float, float]:
        """Half the sides of the axis-aligned box around the origin that contains the shape, m."""
        x, y, z = (np.abs(np.array(self.vertices)).max(axis=0) + self.radius).tolist()
        return x, y, z

    @property
    def bounding_radius(self) -> float:
        """Distance from the origin to the farthest corner, plus the radius, m."""
        return max(math.hypot(*vertex) for vertex in self.vertices) + self.radius

    @property
    def core(self) -> Points:
        """Corners."""
        return self.vertices

    @property
    def core_radius(self) -> float:
        """Radius, m."""
        return self.radius


Shape = Sphere | Capsule | Cylinder | Box | Cone | Convex


@dataclass(frozen=True)
class ShapePart:
    """Part of a body: a shape and the position of its frame in the body's frame (same orientation), m."""

    shape: Shape
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


_CLASSES: dict[str, type[Sphere] | type[Capsule] | type[Cylinder] | type[Box] | type[Cone]] = {
    cls.kind: cls for cls in (Sphere, Capsule, Cylinder, Box, Cone)
}


def is_solid(vertices: ArrayLike) -> bool:
    """Return True if the convex hull of these points is thick enough to have an inside."""
    points = np.array(vertices, dtype=np.float64)
    if len(points) < 4:
        return False
    middle = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(middle.T @ middle)
    extent = np.ptp(middle @ axes, axis=0)
    return bool(extent.min() >= max(THINNEST, 1e-5 * extent.max()))


def shape_from(kind: str, size: Sequence[float]) -> Shape:
    """Return the primitive of a kind with its sizes (m, in the order of ``Shape.size``).

    Raises:
        ModelError: The kind is unknown, the number of sizes is wrong, or a size is not positive.
    """
    if kind not in _CLASSES:
        raise ModelError(f"unknown shape {kind!r}; expected one of {', '.join(_CLASSES)}")
    cls = _CLASSES[kind]
    wanted = [field.name for field in fields(cls)]
    if len(size) != len(wanted):
        raise ModelError(f"a {kind} with {len(size)} size(s); expected {', '.join(wanted)}")
    return cls(*(float(s) for s in size))
