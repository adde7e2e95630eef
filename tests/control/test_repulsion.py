from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.control.gains import Gains
from armgate.control.repulsion import Emergency, Obstacles, Repulsion, push

GAINS = Gains()


def repulsion(radii, obstacles, sinks=True, moves=True):
    every = np.full(len(radii), True)
    return Repulsion(np.array(radii), every & moves, every & sinks, obstacles, GAINS)


def pushed(d):
    return push(d, GAINS.repulsion, GAINS.reach, GAINS)


def test_push_is_the_slope_of_its_potential():
    d = np.linspace(GAINS.reach / 2, 0.99 * GAINS.reach, 20)

    def potential(at):
        return 0.5 * GAINS.repulsion * (1.0 / at - 1.0 / GAINS.reach) ** 2

    np.testing.assert_allclose(
        pushed(d),
        -(potential(d + 1e-7) - potential(d - 1e-7)) / 2e-7,
        rtol=1e-5,
    )


@given(st.floats(-1.0, 1.0))
def test_push_never_pulls_and_is_bounded(d):
    strength = pushed(np.array([d]))[0]
    assert 0.0 <= strength <= GAINS.push
    assert d < GAINS.reach or strength == 0.0


def test_overlapping_spheres_push_apart():
    which, wrenches = repulsion([0.1], Obstacles(np.array([[0.05, 0.0, 0.0]]), np.array([0.1]))).wrenches(
        np.zeros((1, 3))
    )
    assert which.tolist() == [0]
    assert wrenches[0, 0] < 0.0


def test_spheres_on_the_same_spot_stay_finite():
    _, wrenches = repulsion([0.1], Obstacles(np.zeros((1, 3)), np.array([0.1]))).wrenches(np.zeros((1, 3)))
    assert np.isfinite(wrenches).all()


def test_forces_act_along_the_line_of_centres_at_the_centre():
    o, b = np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.5, 0.3])
    _, wrenches = repulsion([0.05], Obstacles(b[None], np.array([0.05]))).wrenches(o[None])
    force = np.array([0.0, -pushed(np.array([0.2]))[0], 0.0])
    np.testing.assert_allclose(wrenches[0], [*force, *np.cross(o, force)])


def test_the_floor_repels_spheres_whose_height_can_change():
    floor, low = Obstacles(floor=-0.1), np.array([[0.3, 0.0, 0.2]])
    _, wrenches = repulsion([0.1], floor).wrenches(low)
    assert wrenches[0, 2] == pytest.approx(pushed(np.array([0.2]))[0])
    assert repulsion([0.1], floor).least_gap(low) == pytest.approx(0.2)
    assert repulsion([0.1], floor, sinks=False).wrenches(low) is None
    assert repulsion([0.1], floor, sinks=False).least_gap(low) == np.inf


def test_without_near_spheres_there_is_no_force():
    far = Obstacles(np.array([[5.0, 0.0, 0.0]]), np.array([0.1]))
    assert repulsion([0.1, 0.1], far).wrenches(np.zeros((2, 3))) is None
    assert repulsion([0.1], Obstacles()).least_gap(np.zeros((1, 3))) == np.inf


def test_a_sphere_that_no_joint_moves_is_ignored():
    """Check a sphere on the axis of the first joint, which cannot evade: no obstacle causes an emergency."""
    beside = Obstacles(np.array([[0.25, 0.0, 0.0]]), np.array([0.1]))
    assert repulsion([0.1], beside).least_gap(np.zeros((1, 3))) == pytest.approx(0.05)
    still = repulsion([0.1], beside, moves=False)
    assert still.least_gap(np.zeros((1, 3))) == np.inf
    assert still.wrenches(np.zeros((1, 3))) is None


def test_emergency_has_hysteresis():
    emergency = Emergency(GAINS)
    on, off = GAINS.emergency_on, GAINS.emergency_off
    between = 0.5 * (on + off)
    states = [emergency.update(gap) for gap in (np.inf, between, on - 1e-6, between, off + 1e-6, between)]
    assert states == [False, False, True, True, False, False]


def test_hysteresis_the_wrong_way_round_is_refused():
    with pytest.raises(ValueError, match="emergency"):
        Emergency(replace(GAINS, emergency_on=0.2, emergency_off=0.1))


def test_centres_without_radii_are_refused():
    with pytest.raises(ValueError, match=r"expected one centre \(m, 3\)"):
        Obstacles(np.zeros((2, 3)), np.zeros(1))
