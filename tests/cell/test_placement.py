import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.cell.placement import Placement

angles = st.floats(-2 * math.pi, 2 * math.pi)
lengths = st.floats(-10.0, 10.0)
triples = st.tuples(lengths, lengths, lengths)
placements = st.builds(Placement.from_rpy, triples, st.tuples(angles, angles, angles))


def same(a: Placement, b: Placement) -> bool:
    return np.allclose(a.R, b.R, atol=1e-9) and np.allclose(a.t, b.t, atol=1e-8)


@given(placements, placements, placements)
def test_composition_is_associative(a, b, c):
    assert same((a @ b) @ c, a @ (b @ c))


@given(placements)
def test_the_inverse_undoes_a_placement(a):
    assert same(a @ a.inverse(), Placement.identity())
    assert same(a.inverse() @ a, Placement.identity())


@given(placements, placements, triples)
def test_composition_applies_the_right_one_first(a, b, point):
    assert np.allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-8)


@given(placements)
def test_rotation_is_orthonormal_and_right_handed(a):
    assert np.allclose(a.R @ a.R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(a.R) == pytest.approx(1.0)


@given(placements)
def test_a_quaternion_round_trip_keeps_the_rotation(a):
    xyzw = a.xyzw()
    assert math.hypot(*xyzw) == pytest.approx(1.0)
    assert xyzw[3] >= 0.0
    assert same(Placement.from_quaternion(tuple(a.t), xyzw), a)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_half_a_turn(axis):
    rpy = [0.0, 0.0, 0.0]
    rpy[axis] = math.pi
    expected = [0.0] * 4
    expected[axis] = 1.0
    assert np.allclose(np.abs(Placement.from_rpy((0, 0, 0), rpy).xyzw()), expected, atol=1e-12)


def test_rpy_turns_about_fixed_axes_x_first():
    turned = Placement.from_rpy((0, 0, 0), (math.pi / 2, 0, math.pi / 2))
    assert np.allclose(turned.apply([0, 1, 0]), [0, 0, 1])  # roll turns y to z, which yaw does not change
    assert np.allclose(turned.apply([1, 0, 0]), [0, 1, 0])


def test_apply_accepts_many_points():
    moved = Placement.from_rpy((1, 2, 3), (0, 0, math.pi)).apply(np.zeros((4, 5, 3)))
    assert moved.shape == (4, 5, 3)
    assert np.allclose(moved, [1, 2, 3])


def test_arrays_are_read_only_copies():
    t = np.zeros(3)
    placement = Placement(np.eye(3), t)
    t[0] = 1.0
    assert placement.t[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        placement.t[0] = 1.0


def test_arrays_of_wrong_shape_are_refused():
    with pytest.raises(ValueError, match=r"expected an array of shape \(3,\), got \(2,\)"):
        Placement(np.eye(3), np.zeros(2))


@pytest.mark.parametrize("xyzw", [(0, 0, 0, 0), (math.nan, 0, 0, 1)])
def test_an_invalid_quaternion_is_refused(xyzw):
    with pytest.raises(ValueError, match="expected a finite quaternion other than zero"):
        Placement.from_quaternion((0, 0, 0), xyzw)
