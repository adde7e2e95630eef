from math import pi

import numpy as np
import pytest

from armgate.control.redundancy.ellipsoids import Ellipsoid, force_ellipsoid, velocity_ellipsoid
from armgate.control.redundancy.measures import condition_number, isotropy, manipulability
from armgate.control.redundancy.spaces import spaces


def on_sphere(n, count=500):
    x = np.random.default_rng(n).normal(size=(n, count))
    return x / np.linalg.norm(x, axis=0)


def test_velocities_of_unit_joint_velocities_lie_in_the_ellipsoid(case):
    """Slide 15, for any robot: ẋᵀ(JJᵀ)⁻¹ẋ ≤ 1, with equality somewhere on each axis."""
    J = case.task.jacobian(case.q())
    ellipsoid = velocity_ellipsoid(J)
    ways = ellipsoid.axes.T @ J @ on_sphere(J.shape[1])
    kept = ellipsoid.lengths > 0.0
    assert (((ways[kept].T / ellipsoid.lengths[kept]) ** 2).sum(axis=1) <= 1.0 + 1e-9).all()
    np.testing.assert_allclose(ways[~kept], 0.0, atol=1e-9)
    found = spaces(J)
    np.testing.assert_allclose(J @ found.row_space, ellipsoid.semi_axes[:, : found.rank], atol=1e-12)


def test_forces_of_unit_torques_lie_on_the_ellipsoid(case):
    """Slide 23: ‖JᵀF‖ = 1 on its surface."""
    J = case.task.jacobian(case.q())
    ellipsoid = force_ellipsoid(J)
    for axis, length in zip(ellipsoid.axes.T, ellipsoid.lengths, strict=True):
        if np.isfinite(length):
            assert np.linalg.norm(J.T @ (length * axis)) == pytest.approx(1.0)
        else:
            np.testing.assert_allclose(J.T @ axis, 0.0, atol=1e-9)


def test_volume_is_proportional_to_the_measure(case):
    """Slide 20."""
    J = case.task.jacobian(case.q())
    ball = {1: 2.0, 2: pi, 3: 4.0 * pi / 3.0, 6: pi**3 / 6.0}[len(J)]
    if len(J) <= J.shape[1]:
        assert velocity_ellipsoid(J).volume == pytest.approx(ball * manipulability(J))


def test_measures_are_those_of_the_ellipsoid(J):
    lengths = velocity_ellipsoid(J).lengths[: min(J.shape)]
    if spaces(J).singular:
        assert isotropy(J) == pytest.approx(0.0, abs=1e-12)
        assert condition_number(J) > 1e12
    else:
        assert isotropy(J) == pytest.approx(lengths.min() / lengths.max())
        assert condition_number(J) == pytest.approx(1.0 / isotropy(J))
        smaller = J @ J.T if J.shape[0] <= J.shape[1] else J.T @ J
        assert manipulability(J) == pytest.approx(np.sqrt(np.linalg.det(smaller)))


def test_measures_of_a_zero_matrix():
    assert (isotropy(np.zeros((2, 2))), condition_number(np.zeros((2, 2)))) == (0.0, np.inf)


def test_the_projection_of_a_velocity_ellipsoid_is_that_of_the_rows(case):
    J = case.task.jacobian(case.q())
    if len(J) < 3:
        return
    rows = np.eye(len(J))[[0, 2]]
    shadow, direct = velocity_ellipsoid(J).projection(rows), velocity_ellipsoid(rows @ J)
    np.testing.assert_allclose(shadow.lengths, direct.lengths, atol=1e-12)
    # The same ellipse; its axes may have the opposite sign.
    np.testing.assert_allclose(
        shadow.semi_axes @ shadow.semi_axes.T, direct.semi_axes @ direct.semi_axes.T, atol=1e-12
    )


def test_map_gives_points_of_the_surface():
    ellipsoid = Ellipsoid(np.array([[0.6, -0.8], [0.8, 0.6]]), np.array([2.0, 0.5]))
    points = ellipsoid.axes.T @ ellipsoid.map(on_sphere(2))
    np.testing.assert_allclose(((points.T / ellipsoid.lengths) ** 2).sum(axis=1), 1.0)


def test_a_projection_needs_a_bounded_ellipsoid():
    with pytest.raises(ValueError, match="unbounded"):
        force_ellipsoid([[1.0, 0.0], [0.0, 0.0]]).projection(np.eye(2)[:1])
    with pytest.raises(ValueError, match="expected a map"):
        velocity_ellipsoid(np.eye(2)).projection(np.eye(3))
