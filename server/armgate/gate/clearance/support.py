"""Support functions: the reach of a convex body in a direction.

h_X(v) = max over x in X of v·x. The slab of two bodies A and B is between the planes with the unit normal n
that support them. Its width lb = −h_B(−n) − h_A(n) never exceeds their signed distance, for any n. So n is a
certificate, however it was found. Most primitives share one form,

    h(v) = hx|vx| + hy|vy| + hz|vz| + disk·√(vx² + vy²) + radius·|v|,

the Minkowski sum of a box with half sides h, a segment (hz), a disk and a ball: sphere (radius), capsule (hz
+ radius), cylinder (disk + hz), box (hx, hy, hz). A body with corners p_k, each with a disk of radius d_k
perpendicular to z,

    h(v) = max_k (p_k·v + d_k·√(vx² + vy²)) + radius·|v|,

is a convex hull (d = 0), thickened by the radius, or a cone (its tip, and its base as one corner with a
disk). For cells without such bodies the rows alone are enough.

The compiled form of `support` is ``kernels._support``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Shape, Sphere

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Cornered:
    """Support parameters of bodies of which some have corners.

    Attributes:
        rows: Parameters as for primitives, (…, 5); of a body with corners only the radius counts.
        body: Index into ``corners`` of each body, −1 for a primitive, (…).
        corners: x, y, z and disk of every body with corners, (b, most corners, 4); the last corner is
            repeated.
    """

    rows: Array
    body: Index
    corners: Array

    def __getitem__(self, sel: Index | int) -> "Cornered":
        return Cornered(self.rows[sel], self.body[sel], self.corners)

    def __len__(self) -> int:
        return len(self.rows)


Rows = Array | Cornered


def support_row(shape: Shape) -> tuple[float, float, float, float, float]:
    """Return (hx, hy, hz, disk, radius) of one shape, m; the radius only for a shape with corners."""
    match shape:
        case Sphere(radius=r):
            return 0.0, 0.0, 0.0, 0.0, r
        case Capsule(radius=r, length=length):
            return 0.0, 0.0, length / 2, 0.0, r
        case Cylinder(radius=r, length=length):
            return 0.0, 0.0, length / 2, r, 0.0
        case Box(x=x, y=y, z=z):
            return x / 2, y / 2, z / 2, 0.0, 0.0
        case Cone():
            return 0.0, 0.0, 0.0, 0.0, 0.0
        case Convex(radius=r):
            return 0.0, 0.0, 0.0, 0.0, r
        case _:
            assert_never(shape)


def corners_of(shape: Shape) -> list[tuple[float, float, float, float]]:
    """Return (x, y, z, disk) of each corner of one shape, m; nothing for a shape without corners."""
    match shape:
        case Cone(radius=r, length=length):
            return [(0.0, 0.0, length / 2, 0.0), (0.0, 0.0, -length / 2, r)]
        case Convex(vertices=vertices):
            return [(x, y, z, 0.0) for x, y, z in vertices]
        case Sphere() | Capsule() | Cylinder() | Box():
            return []
        case _:
            assert_never(shape)


def support_table(shapes: Sequence[Shape]) -> Rows:
    """Return support parameters, one entry per shape."""
    rows = np.array([support_row(s) for s in shapes], dtype=np.float64).reshape(len(shapes), 5)
    corners = {k: c for k, s in enumerate(shapes) if (c := corners_of(s))}
    if not corners:
        return rows
    body, most = np.full(len(shapes), -1, dtype=np.intp), max(map(len, corners.values()))
    body[list(corners)] = np.arange(len(corners))
    padded = np.array([c + c[-1:] * (most - len(c)) for c in corners.values()], dtype=np.float64)
    return Cornered(rows, body, padded)


def support(rows: Rows, v: Array) -> Array:
    """Return h(v) of bodies centred at the origin of their own frames.

    Args:
        rows: Support parameters of P bodies, or of one.
        v: Unit directions in the bodies' frames, (…, P, 3), or (3,) for one.
    """
    if isinstance(rows, Cornered):
        return _with_corners(rows, v)
    x, y, z = np.abs(v[..., 0]), np.abs(v[..., 1]), np.abs(v[..., 2])
    flat = rows[..., 0] * x + rows[..., 1] * y + rows[..., 2] * z
    result: Array = flat + rows[..., 3] * np.sqrt(x * x + y * y) + rows[..., 4]
    return result


def support_of_one(row: Rows, v: Array) -> float:
    """Return h(v) of one body in the direction v, (3,), as `support`, without arrays of length one."""
    if isinstance(row, Cornered):
        return float(_with_corners(row, v))
    hx, hy, hz, disk, radius = row.tolist()
    x, y, z = v.tolist()
    reached: float = hx * abs(x) + hy * abs(y) + hz * abs(z) + disk * sqrt(x * x + y * y) + radius
    return reached


def _with_corners(given: Cornered, v: Array) -> Array:
    plain = np.asarray(support(given.rows, v))
    chosen = np.flatnonzero(given.body >= 0)
    if len(chosen) == 0:
        return plain
    count = given.body.size
    result = plain.reshape(-1, count)
    directions = v.reshape(-1, count, 3)[:, chosen]
    level = np.sqrt(directions[..., 0] ** 2 + directions[..., 1] ** 2)
    corners = given.corners[given.body.reshape(-1)[chosen]]
    along = np.concatenate([directions, level[..., None]], axis=-1).transpose(1, 2, 0)
    result[:, chosen] += (corners @ along).max(axis=1).T
    return result.reshape(plain.shape)
