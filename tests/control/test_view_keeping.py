import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.control.view_keeping import corrected, drawn_in, projection, slowed, view_vector

plane = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@given(plane)
def test_view_vector_and_projection_are_inverse(v):
    np.testing.assert_allclose(view_vector(projection(v)), v, rtol=1e-9, atol=1e-12)


def test_a_view_vector_is_as_long_as_the_angle():
    assert np.hypot(*view_vector((np.tan(0.35) * 0.6, np.tan(0.35) * 0.8))) == pytest.approx(0.7)


@given(plane, plane, plane)
def test_drawn_in_keeps_the_direction_and_is_no_wider_than_the_line_from_start_to_end(v, start, end):
    ours = drawn_in(v, start, end)
    assert np.hypot(*ours) <= max(np.hypot(*start), np.hypot(*end)) + 1e-12
    assert np.hypot(*ours) <= np.hypot(*v) + 1e-12
    assert ours[0] * v[1] == pytest.approx(ours[1] * v[0], abs=1e-9)


def test_a_view_that_is_narrow_enough_is_unchanged():
    assert drawn_in((0.1, 0.05), (0.4, 0.0), (0.2, 0.0)) == (0.1, 0.05)


J = np.array([[1.0, 0.2, 0.0, 0.3], [0.0, -0.5, 1.0, 0.1]])


def test_a_correction_within_the_bounds_is_exact():
    dq, missing = np.zeros(4), (0.01, -0.02)
    ours = corrected(dq, missing, J, np.full(4, -1.0), np.full(4, 1.0))
    np.testing.assert_allclose(J @ ours, missing, rtol=1e-5)


def test_other_joints_take_over_from_a_joint_at_its_bound():
    low, high = np.full(4, -1.0), np.array([0.002, 1.0, 1.0, 1.0])
    ours = corrected(np.zeros(4), (0.05, 0.0), J, low, high)
    assert ours[0] == 0.002
    np.testing.assert_allclose(J @ ours, (0.05, 0.0), atol=1e-6)


@given(st.tuples(*[st.floats(-5.0, 5.0)] * 2), st.tuples(*[st.floats(0.0, 0.1)] * 4))
def test_corrections_stay_within_bounds(missing, room):
    high = np.array(room)
    ours = corrected(np.zeros(4), missing, J, -high, high)
    assert (np.abs(ours) <= high).all()


def test_a_task_that_no_joint_moves_changes_nothing():
    np.testing.assert_array_equal(
        corrected(np.ones(4), (1.0, 0.0), np.zeros((2, 4)), np.zeros(4), np.full(4, 2.0)), np.ones(4)
    )


def test_the_angle_is_braked_but_the_induced_motion_is_not():
    J_t, change = np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]]), np.full(3, 1e-3)
    psi, induced = (np.tan(0.05), 0.0), np.array([0.0, 0.01, 0.02])
    fast, slow = np.array([-0.1, 0.0, 0.0]), np.array([-1e-3, 0.0, 0.0])
    ours = slowed(induced + fast, induced, psi, J_t, change) - induced
    np.testing.assert_allclose(ours / ours[0], fast / fast[0])
    assert -0.02 < ours[0] < -0.005
    np.testing.assert_array_equal(slowed(induced + slow, induced, psi, J_t, change), induced + slow)
    np.testing.assert_array_equal(slowed(fast, induced, (0.0, 0.0), J_t, change), fast)
