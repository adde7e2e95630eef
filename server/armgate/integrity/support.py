"""Support functions: how far a convex body reaches in a direction.

h_X(v) = max over x in X of v·x. A separating slab is its own proof: for any unit n,
lb = −h_B(−n) − h_A(n) never exceeds the signed distance of A and B, whatever suggested n. All primitives
share one form,

    h(v) = hx|vx| + hy|vy| + hz|vz| + disk·√(vx² + vy²) + radius·|v|,

a box with half sides h, a segment (hz), a disk and a ball added together: sphere (radius), capsule (hz +
radius), cylinder (disk + hz), box (hx, hy, hz).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armgate.cell.shapes import Box, Capsule, Cylinder, Shape, Sphere

Array = NDArray[np.float64]


def support_row(shape: Shape) -> tuple[float, float, float, float, float]:
    """Returns (hx, hy, hz, disk, radius) of one shape, m."""
    match shape:
        case Sphere(radius=r):
            return 0.0, 0.0, 0.0, 0.0, r
        case Capsule(radius=r, length=length):
            return 0.0, 0.0, length / 2, 0.0, r
        case Cylinder(radius=r, length=length):
            return 0.0, 0.0, length / 2, r, 0.0
        case Box(x=x, y=y, z=z):
            return x / 2, y / 2, z / 2, 0.0, 0.0


def support_table(shapes: Sequence[Shape]) -> Array:
    """Returns one row of support parameters a shape, (k, 5)."""
    return np.array([support_row(s) for s in shapes], dtype=np.float64).reshape(len(shapes), 5)


def support(rows: Array, v: Array) -> Array:
    """Returns h(v) of bodies centred at the origin of their own frames.

    Args:
        rows: Support parameters, (…, 5).
        v: Directions in the bodies' frames, (…, 3); of length one.
    """
    x, y, z = np.abs(v[..., 0]), np.abs(v[..., 1]), np.abs(v[..., 2])
    flat = rows[..., 0] * x + rows[..., 1] * y + rows[..., 2] * z
    result: Array = flat + rows[..., 3] * np.sqrt(x * x + y * y) + rows[..., 4]
    return result
