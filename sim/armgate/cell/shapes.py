"""The primitive bodies: convex, centred in their frame, their axis along z; all sizes in m."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import ClassVar, Literal

from armgate.cell.errors import ModelError

Kind = Literal["sphere", "capsule", "cylinder", "box"]
Points = tuple[tuple[float, float, float], ...]


class Primitive:
    """What all shapes share.

    Attributes:
        kind: The shape's name in the configuration and on the wire.
    """

    __slots__ = ()
    kind: ClassVar[Kind]

    def __post_init__(self) -> None:
        for size in self.size:
            if not (math.isfinite(size) and size > 0.0):
                raise ModelError(
                    f"a {self.kind} cannot have the size {size}; expected a positive number of metres"
                )

    @property
    def size(self) -> tuple[float, ...]:
        """The sizes in the order of the configuration and the wire, m."""
        return tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball around the centre that holds the shape, m."""
        raise NotImplementedError

    @property
    def core(self) -> Points:
        """Points whose convex hull, thickened by ``core_radius``, holds the shape.

        It is exactly the shape but for a cylinder, which is held by the capsule of its ends.
        """
        raise NotImplementedError

    @property
    def core_radius(self) -> float:
        """Thickness around the core, m."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Sphere(Primitive):
    """All points within ``radius`` of the centre."""

    kind: ClassVar[Kind] = "sphere"
    radius: float

    @property
    def bounding_radius(self) -> float:
        """The radius, m."""
        return self.radius

    @property
    def core(self) -> Points:
        """The centre."""
        return ((0.0, 0.0, 0.0),)

    @property
    def core_radius(self) -> float:
        """The radius, m."""
        return self.radius


class _Round(Primitive):
    """Something around a segment along z."""

    __slots__ = ()
    radius: float
    length: float

    @property
    def core(self) -> Points:
        """Both ends of the segment."""
        return ((0.0, 0.0, -self.length / 2), (0.0, 0.0, self.length / 2))

    @property
    def core_radius(self) -> float:
        """The radius, m."""
        return self.radius


@dataclass(frozen=True, slots=True)
class Capsule(_Round):
    """All points within ``radius`` of a segment of ``length`` along z (the caps are not in the length)."""

    kind: ClassVar[Kind] = "capsule"
    radius: float
    length: float

    @property
    def bounding_radius(self) -> float:
        """Half the segment and a cap, m."""
        return self.length / 2 + self.radius


@dataclass(frozen=True, slots=True)
class Cylinder(_Round):
    """A flat-ended cylinder around z."""

    kind: ClassVar[Kind] = "cylinder"
    radius: float
    length: float

    @property
    def bounding_radius(self) -> float:
        """From the centre to a rim, m."""
        return math.hypot(self.length / 2, self.radius)


@dataclass(frozen=True, slots=True)
class Box(Primitive):
    """A box with full edge lengths ``x``, ``y``, ``z``."""

    kind: ClassVar[Kind] = "box"
    x: float
    y: float
    z: float

    @property
    def bounding_radius(self) -> float:
        """Half the diagonal, m."""
        return math.hypot(self.x, self.y, self.z) / 2

    @property
    def core(self) -> Points:
        """The eight corners."""
        xs, ys, zs = ((-edge / 2, edge / 2) for edge in self.size)
        return tuple(product(xs, ys, zs))

    @property
    def core_radius(self) -> float:
        """Nothing."""
        return 0.0


Shape = Sphere | Capsule | Cylinder | Box

_CLASSES: dict[str, type[Sphere] | type[Capsule] | type[Cylinder] | type[Box]] = {
    cls.kind: cls for cls in (Sphere, Capsule, Cylinder, Box)
}


def shape_from(kind: str, size: Sequence[float]) -> Shape:
    """The shape of this kind and size (m, in the order of ``Shape.size``).

    Raises:
        ModelError: An unknown kind, a wrong count of sizes, or a size that is not positive.
    """
    if kind not in _CLASSES:
        raise ModelError(f"unknown shape {kind!r}; expected one of {', '.join(_CLASSES)}")
    cls = _CLASSES[kind]
    wanted = [field.name for field in fields(cls)]
    if len(size) != len(wanted):
        raise ModelError(f"a {kind} with {len(size)} size(s); expected {', '.join(wanted)}")
    return cls(*(float(s) for s in size))
