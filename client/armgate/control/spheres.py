"""Bounding spheres of a robot, built from the bodies of its model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, hypot, sqrt
from typing import assert_never

import numpy as np

from armgate.cell.model import RobotModel
from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Shape, Sphere
from armgate.control.vectors import V3
from armgate.control.weights import Vector

# Ratio of the radius of a row's spheres to the radius of the body: larger spheres need fewer in a row. With
# this ratio a row has a sphere every 1.5 radii of the body.
STRETCH = 1.25
# Largest number of spheres of a body; those of a long thin body are larger instead.
MOST = 8


@dataclass(frozen=True, slots=True)
class Spheres:
    """Spheres that together cover bodies of a robot: the moving ones, or those of its base.

    Attributes:
        model: robot whose bodies they cover.
        bodies: index of each sphere's body in `model.bodies`, (k,).
        joints: joint that carries the sphere, (k,); −1 for the base.
        offsets: centre in the body's own frame, (k, 3), m.
        radii: (k,), m.
    """

    model: RobotModel
    bodies: tuple[int, ...]
    joints: tuple[int, ...]
    offsets: Vector
    radii: Vector

    @classmethod
    def of(cls, model: RobotModel) -> Spheres:
        """Return the spheres of all bodies of `model` that a joint moves."""
        return cls._of(model, [index for index, body in enumerate(model.bodies) if body.joint >= 0])

    @classmethod
    def of_base(cls, model: RobotModel) -> Spheres:
        """Return the spheres of the bodies of its base."""
        return cls._of(model, [index for index, body in enumerate(model.bodies) if body.joint < 0])

    @classmethod
    def _of(cls, model: RobotModel, bodies: list[int]) -> Spheres:
        rows = [
            (index, model.bodies[index].joint, offset, radius)
            for index in bodies
            for offset, radius in cover(model.bodies[index].shape)
        ]
        return cls(
            model,
            tuple(row[0] for row in rows),
            tuple(row[1] for row in rows),
            np.array([row[2] for row in rows]).reshape(-1, 3),
            np.array([row[3] for row in rows]),
        )

    def centres(self, q: Vector) -> Vector:
        """Return their centres in the world at q ((n,), rad or m), (k, 3), m."""
        R, t = self.model.body_placements(q)
        index = list(self.bodies)
        centres: Vector = np.einsum("kij,kj->ki", R[index], self.offsets) + t[index]
        return centres

    def in_joint(self, sphere: int) -> Vector:
        """Return the centre of one sphere in the frame of its joint, (3,), m."""
        placement = self.model.bodies[self.bodies[sphere]].placement
        point: Vector = placement.R @ self.offsets[sphere] + placement.t
        return point


def cover(shape: Shape) -> Iterator[tuple[V3, float]]:
    """Yield spheres (centre in the shape's frame, radius) that together contain the shape.

    The spheres form a row along the longest axis. Between two centres 2h apart, spheres of radius √(c² + h²)
    cover a cross section of radius c. If the ends are round, the outer spheres are centred at the centres of
    the ends; if they are flat, at the distance h inside of them. A cone is covered as a cylinder, a convex
    body as its box.
    """
    match shape:
        case Sphere(radius):
            yield (0.0, 0.0, 0.0), radius
        case Capsule(radius, length):
            h = 0.5 * length / _count(length, radius)
            yield from _row(2, 0.5 * length, h, radius)
        case Cylinder(radius, length):
            h = 0.5 * length / _count(length, radius)
            yield from _row(2, 0.5 * length - h, h, radius)
        case Cone(radius, length):
            yield from cover(Cylinder(radius, length))
        case Convex():
            x, y, z = (2.0 * half for half in shape.half_sides)
            yield from cover(Box(x, y, z))
        case Box(x, y, z):
            sides = (x, y, z)
            longest = int(np.argmax(sides))
            across = 0.5 * hypot(*(side for axis, side in enumerate(sides) if axis != longest))
            h = 0.5 * sides[longest] / _count(sides[longest], across)
            yield from _row(longest, 0.5 * sides[longest] - h, h, across)
        case _:
            assert_never(shape)


def _count(length: float, across: float) -> int:
    return min(max(ceil(0.5 * length / (across * sqrt(STRETCH**2 - 1.0))), 1), MOST)


def _row(axis: int, end: float, h: float, across: float) -> Iterator[tuple[V3, float]]:
    count = round(end / h) + 1
    for i in range(count):
        centre = [0.0, 0.0, 0.0]
        centre[axis] = -end + 2.0 * h * i
        yield (centre[0], centre[1], centre[2]), hypot(across, h)
