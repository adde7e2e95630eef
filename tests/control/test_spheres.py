import numpy as np
import pytest

from armgate.cell.shapes import Box, Capsule, Cylinder, Sphere
from armgate.control.spheres import MOST, Spheres, cover

SHAPES = [
    Sphere(0.2),
    Capsule(0.1, 0.68),
    Capsule(0.1, 0.05),
    Cylinder(0.1, 0.5),
    Cylinder(0.3, 0.1),
    Cylinder(0.02, 3.0),
    Box(0.1, 0.8, 0.2),
    Box(4.0, 0.1, 0.1),
    Box(0.1, 0.1, 0.1),
]


def points_in(shape, rng, count=4000):
    """Return uniform points in the shape's box, without those outside of the shape."""
    if isinstance(shape, Box):
        return rng.uniform(-0.5, 0.5, (count, 3)) * shape.size
    caps = shape.radius if isinstance(shape, Sphere | Capsule) else 0.0
    half = 0.0 if isinstance(shape, Sphere) else 0.5 * shape.length
    points = rng.uniform(-1.0, 1.0, (count, 3)) * [shape.radius, shape.radius, half + caps]
    beyond = np.maximum(np.abs(points[:, 2]) - half, 0.0) if caps else 0.0
    return points[np.hypot(np.hypot(points[:, 0], points[:, 1]), beyond) <= shape.radius]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_cover_contains_the_shape(shape):
    spheres = list(cover(shape))
    assert len(spheres) <= MOST + 1
    points = points_in(shape, np.random.default_rng(1))
    covered = np.zeros(len(points), bool)
    for centre, radius in spheres:
        covered |= np.linalg.norm(points - centre, axis=1) <= radius + 1e-12
    assert covered.all()


def test_cover_is_not_much_thicker_than_a_link():
    assert max(radius for _, radius in cover(Capsule(0.1, 0.68))) < 0.126


def test_a_robot_is_covered_except_for_its_base(fr):
    spheres = Spheres.of(fr.model)
    moving = {k for k, body in enumerate(fr.model.bodies) if body.joint >= 0}
    assert set(spheres.bodies) == moving
    assert len(moving) < len(fr.model.bodies)


def test_centres_follow_the_bodies(fr, law, q):
    """Compare the slow computation by the model with the fast one by pinocchio's frames."""
    R, t = fr.model.body_placements(q)
    expected = [
        R[b] @ offset + t[b] for b, offset in zip(law.spheres.bodies, law.spheres.offsets, strict=True)
    ]
    np.testing.assert_allclose(law.spheres.centres(q), expected)
    law._arm.place(q)
    np.testing.assert_allclose(law._arm.centres(), expected)


def test_lever_bounds_the_motion_of_the_centres(law, q):
    rng = np.random.default_rng(0)
    for _ in range(20):
        dq = rng.normal(scale=0.3, size=6)
        moved = np.linalg.norm(law.spheres.centres(q + dq) - law.spheres.centres(q), axis=1)
        assert moved.max() <= np.abs(dq) @ law._arm.lever + 1e-12
