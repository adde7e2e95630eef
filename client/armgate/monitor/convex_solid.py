"""Convex solids by their support function: hull of points or of discs normal to z, thickened by a radius.

    h(d) = max_i (p_i·d + ρ_i·√(d_x² + d_y²)) + r·|d|

with points p_i, radii ρ_i of the discs around them, and the thickness r. This represents every primitive of
the configuration exactly: a sphere is a point and a capsule a segment, each with a thickness; a cylinder is
two discs; a cone is a disc and a point; a box and a hull are points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.errors import DescriptionError

Array = NDArray[np.float64]

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "cone": 2, "box": 3}
"""Primitives, and the number of sizes of each."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex solid in its own frame.

    Attributes:
        points: (k, 3), m.
        discs: Radius of the disc around each point, normal to z, (k,), m.
        radius: Thickness all around, m.
        opened: Returns the solids inside, if this one is only a box around them.
    """

    points: Array
    discs: Array
    radius: float
    opened: "Callable[[], tuple[Solid, ...]] | None" = None

    @cached_property
    def children(self) -> "tuple[Solid, ...]":
        """The solids inside; empty if this solid is not just a box around others."""
        return () if self.opened is None else self.opened()

    @property
    def extent(self) -> float:
        """Radius of a ball around the origin of the frame that contains the solid, m."""
        return float((np.linalg.norm(self.points, axis=1) + self.discs).max()) + self.radius

    @property
    def middle(self) -> Array:
        """Middle of the points, (3,), m."""
        return np.asarray((self.points.min(axis=0) + self.points.max(axis=0)) / 2.0)


def primitive(kind: str, size: Sequence[float], where: str) -> Solid:
    """Return a primitive, centred, with its axis along z.

    Raises:
        DescriptionError: An unknown kind, a wrong number of sizes, or a size that is not positive.
    """
    if SIZES.get(kind) != len(size):
        raise DescriptionError(f"{where}: no support for the shape {kind!r} with {len(size)} sizes")
    if min(size) <= 0.0:
        raise DescriptionError(f"{where}: a {kind} with the sizes {list(size)}; expected positive sizes")
    if kind == "box":
        return hull(np.array(list(product(*((-s / 2.0, s / 2.0) for s in size)))))
    if kind == "sphere":
        return Solid(np.zeros((1, 3)), np.zeros(1), size[0])
    ends = np.array([[0.0, 0.0, -size[1] / 2.0], [0.0, 0.0, size[1] / 2.0]])
    if kind == "capsule":
        return Solid(ends, np.zeros(2), size[0])
    return Solid(ends, np.array([size[0], size[0] if kind == "cylinder" else 0.0]), 0.0)


def box_around(points: Array, radius: float, opened: "Callable[[], tuple[Solid, ...]]") -> Solid:
    """Return the axis-aligned box around points (k, 3) thickened by a radius; see ``Solid.opened``."""
    low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
    return Solid(np.array(list(product(*zip(low, high, strict=True)))), np.zeros(8), 0.0, opened)


def hull(points: Array, radius: float = 0.0) -> Solid:
    """Return the convex hull of points (k, 3), thickened by a radius."""
    return Solid(points, np.zeros(len(points)), radius)
