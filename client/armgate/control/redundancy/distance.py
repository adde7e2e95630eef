"""Signed distances of points from shapes, and their gradients.

A cone is treated as its bounding cylinder, a convex body as its bounding box, which underestimates the
distance.
"""

from typing import assert_never

import numpy as np

from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Shape, Sphere
from armgate.control.redundancy.spaces import Array


def point_distances(points: Array, shape: Shape, placement: Placement) -> tuple[Array, Array]:
    """Return the distances of points from a shape's surface, negative inside.

    Args:
        points: (k, 3), world, m.
        shape: the shape.
        placement: pose of the shape in the world.

    Returns:
        Distances (k,), m, and their gradients, unit vectors (k, 3) in the world. If several points of the
        surface are nearest (at the centre of a sphere), the gradient is the direction to one of them.
    """
    local = placement.inverse().apply(points)
    match _simple(shape):
        case Sphere(radius):
            d, n = _from_points(local, radius)
        case Capsule(radius, length):
            axis = np.zeros_like(local)
            axis[:, 2] = np.clip(local[:, 2], -0.5 * length, 0.5 * length)
            d, n = _from_points(local - axis, radius)
        case Cylinder(radius, length):
            d, n = _from_cylinder(local, radius, length)
        case Box(x, y, z):
            d, n = _from_corner(np.abs(local) - 0.5 * np.array([x, y, z]))
            n *= _signs(local)
        case other:
            assert_never(other)
    return d, n @ placement.R.T


def _simple(shape: Shape) -> Sphere | Capsule | Cylinder | Box:
    match shape:
        case Cone(radius, length):
            return Cylinder(radius, length)
        case Convex():
            x, y, z = shape.half_sides
            return Box(2.0 * x, 2.0 * y, 2.0 * z)
        case Sphere() | Capsule() | Cylinder() | Box():
            return shape
        case _:
            assert_never(shape)


def _from_points(ways: Array, radius: float) -> tuple[Array, Array]:
    length = np.linalg.norm(ways, axis=1)
    return length - radius, _units(ways, length)


def _from_cylinder(local: Array, radius: float, length: float) -> tuple[Array, Array]:
    """Return distances from a cylinder: in the half plane through axis and point it is a box corner."""
    across = local * np.array([1.0, 1.0, 0.0])
    outward = np.linalg.norm(across, axis=1)
    d, corner = _from_corner(np.stack([outward - radius, np.abs(local[:, 2]) - 0.5 * length], axis=1))
    n = corner[:, :1] * _units(across, outward)
    n[:, 2] = corner[:, 1] * _signs(local[:, 2])
    return d, n


def _from_corner(beyond: Array) -> tuple[Array, Array]:
    """Return distances from the corner {x ≤ 0}; `beyond` is each point's distance past the faces, (k, c)."""
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=1)
    nearest = np.eye(beyond.shape[1])[np.argmax(beyond, axis=1)]
    inside = length == 0.0
    d = np.where(inside, beyond.max(axis=1), length)
    n = np.where(inside[:, None], nearest, outside / np.where(inside, 1.0, length)[:, None])
    return d, n


def _units(ways: Array, length: Array) -> Array:
    """Return displacements of these lengths as unit vectors; the x axis for length 0."""
    none = length == 0.0
    units: Array = ways / np.where(none, 1.0, length)[:, None]
    units[none] = (1.0, 0.0, 0.0)
    return units


def _signs(values: Array) -> Array:
    return np.where(values < 0.0, -1.0, 1.0)
