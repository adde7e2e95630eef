from math import pi, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.cell.placement import rotation_from_rpy
from armgate.control.stereographic import camera_error

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
angles = st.floats(-pi, pi)
coordinates = st.floats(-10.0, 10.0)


@pytest.mark.parametrize("theta", [0.0, 1e-9, 0.3, 1.5, 3.0, pi - 1e-3])
@pytest.mark.parametrize("direction", [0.0, 0.7, 4.0])
def test_psi_is_the_tangent_of_half_the_angle(theta, direction):
    ray = 2.5 * np.array(
        [np.sin(theta) * np.cos(direction), np.sin(theta) * np.sin(direction), np.cos(theta)]
    )
    error = camera_error(*AXES, tuple(ray))
    np.testing.assert_allclose(
        error.psi, tan(theta / 2) * np.array([np.cos(direction), np.sin(direction)]), rtol=1e-9, atol=1e-12
    )
    assert error.distance == pytest.approx(2.5)


@pytest.mark.parametrize("seed", range(20))
def test_gradient_against_differences(seed, differences):
    rng = np.random.default_rng(seed)
    axes = [tuple(column) for column in rotation_from_rpy(rng.uniform(-3, 3, 3)).T]
    r = rng.normal(size=3)
    error = camera_error(*axes, tuple(r))
    numeric = differences(lambda at: camera_error(*axes, tuple(at)).psi, r)
    np.testing.assert_allclose([error.g1, error.g2], numeric, rtol=1e-6, atol=1e-7)


def test_the_antipode_is_left_along_a_fixed_direction():
    error = camera_error(*AXES, (0.0, 0.0, -1.0))
    assert error.psi[0] > 1e3
    assert error.psi[1] == 0.0
    assert np.isfinite([error.g1, error.g2]).all()


def test_a_target_in_the_lens_counts_as_straight_ahead():
    error = camera_error(*AXES, (0.0, 0.0, 0.0))
    assert error.psi == (0.0, 0.0)
    assert error.ray == (0.0, 0.0, 1.0)
    assert np.isfinite([error.g1, error.g2]).all()


@given(st.tuples(angles, angles, angles), st.tuples(coordinates, coordinates, coordinates))
def test_finite_everywhere(rpy, r):
    axes = [tuple(column) for column in rotation_from_rpy(rpy).T]
    error = camera_error(*axes, r)
    assert np.isfinite([*error.psi, *error.g1, *error.g2, *error.ray, error.distance]).all()
