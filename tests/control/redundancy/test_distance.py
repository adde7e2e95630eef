import numpy as np
import pytest

from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Sphere
from armgate.control.redundancy.distance import point_distances

SHAPES = [Sphere(0.4), Capsule(0.2, 0.6), Cylinder(0.3, 0.5), Box(0.4, 0.6, 0.8)]
PLACE = Placement.from_rpy([0.3, -0.2, 0.5], [0.4, -0.7, 1.1])


def surface(shape, count=40_000):
    """Return dense points on the surface of a shape."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    match shape:
        case Sphere(r):
            return r * u
        case Capsule(r, length):
            side = u * [1.0, 1.0, 0.0]
            side = r * side / np.linalg.norm(side, axis=1, keepdims=True)
            side[:, 2] = rng.uniform(-0.5 * length, 0.5 * length, count)
            ends = r * u + np.sign(u[:, 2:]) * [0.0, 0.0, 0.5 * length]
            return np.concatenate([side, ends])
        case Cylinder(r, length):
            side = u * [1.0, 1.0, 0.0]
            side = r * side / np.linalg.norm(side, axis=1, keepdims=True)
            side[:, 2] = rng.uniform(-0.5 * length, 0.5 * length, count)
            ends = side * np.sqrt(rng.uniform(size=(count, 1)))
            ends[:, 2] = 0.5 * length * np.sign(u[:, 2])
            return np.concatenate([side, ends])
        case Box(x, y, z):
            points = rng.uniform(-0.5, 0.5, (count, 3))
            axis = rng.integers(3, size=count)
            points[np.arange(count), axis] = 0.5 * np.sign(u[:, 0])
            return points * [x, y, z]


@pytest.fixture(params=SHAPES, ids=lambda shape: shape.kind)
def shape(request):
    return request.param


@pytest.fixture
def points():
    return np.random.default_rng(1).uniform(-0.6, 0.6, (80, 3)) + PLACE.t


def test_distance_is_that_of_the_nearest_point_of_the_surface(shape, points):
    d, _ = point_distances(points, shape, PLACE)
    dense = PLACE.apply(surface(shape))
    nearest = np.array([np.linalg.norm(dense - point, axis=1).min() for point in points])
    np.testing.assert_allclose(np.abs(d), nearest, atol=0.015)
    assert (d < 0.0).any()
    assert (np.abs(d) <= nearest + 1e-12).all()


def test_inside_is_negative(shape):
    inside = 0.5 * surface(shape, 100)
    d, _ = point_distances(PLACE.apply(inside), shape, PLACE)
    assert (d < 0.0).all()
    outside = 1.5 * surface(shape, 100)
    assert (point_distances(PLACE.apply(outside), shape, PLACE)[0] > 0.0).all()


def test_direction_is_the_gradient(shape, points, differences):
    _, n = point_distances(points, shape, PLACE)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
    for point, direction in zip(points, n, strict=True):
        slope = differences(lambda p: point_distances(p[None], shape, PLACE)[0][0], point)
        np.testing.assert_allclose(direction, slope, atol=1e-5)


def test_the_gradient_in_the_centre_points_to_one_of_the_nearest_surface_points(shape):
    d, n = point_distances(PLACE.t[None], shape, PLACE)
    assert np.linalg.norm(n) == pytest.approx(1.0)
    step, _ = point_distances(PLACE.t[None] + 1e-3 * n, shape, PLACE)
    assert step[0] == pytest.approx(d[0] + 1e-3)


def test_distances_to_cones_and_convex_bodies_are_those_to_an_enclosing_shape(points):
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    rim = np.stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), np.full(50, -0.25)], axis=1)
    convex, _ = Convex.centred(np.random.default_rng(2).uniform(-0.4, 0.4, (12, 3)).tolist(), 0.05)
    cone = np.concatenate([rim, [[0.0, 0.0, 0.25]]])
    for shape, local in ((Cone(0.3, 0.5), cone), (convex, np.array(convex.vertices))):
        d, n = point_distances(points, shape, PLACE)
        inside = PLACE.apply(local)
        nearest = np.linalg.norm(points[:, None] - inside, axis=2).min(axis=1)
        assert (d <= nearest + 1e-12).all()
        assert (point_distances(0.9 * inside + 0.1 * PLACE.t, shape, PLACE)[0] < 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
