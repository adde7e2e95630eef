"""Tests of the emulated robot against the exact solution of a first-order lag."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator import EmulatedRobot


def test_without_lag_the_robot_reaches_the_setpoint_in_one_cycle():
    robot = EmulatedRobot((0.0, 1.0), 0.012, 0.0)
    assert robot.q == (0.0, 1.0)
    assert robot.step((0.3, -0.1)) == (0.3, -0.1)
    assert robot.q == (0.3, -0.1)


@given(
    lag=st.floats(1e-4, 1.0),
    period=st.floats(1e-3, 0.1),
    q0=st.floats(-3, 3),
    target=st.floats(-3, 3),
    steps=st.integers(1, 50),
)
def test_a_held_setpoint_is_approached_exponentially(lag, period, q0, target, steps):
    robot = EmulatedRobot((q0,), period, lag)
    for _ in range(steps):
        robot.step((target,))
    expected = target + (q0 - target) * math.exp(-steps * period / lag)
    assert robot.q[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("period", "lag"), [(0.0, 0.03), (-0.012, 0.03), (math.nan, 0.0)])
def test_a_period_that_is_not_positive_is_refused(period, lag):
    with pytest.raises(ValueError, match="period"):
        EmulatedRobot((0.0,), period, lag)


@pytest.mark.parametrize("lag", [-0.01, math.inf, math.nan])
def test_a_lag_that_is_negative_or_not_finite_is_refused(lag):
    with pytest.raises(ValueError, match="lag"):
        EmulatedRobot((0.0,), 0.012, lag)


def test_a_setpoint_of_another_length_is_refused():
    with pytest.raises(ValueError, match="zip"):
        EmulatedRobot((0.0, 0.0), 0.012, 0.03).step((0.0,))


def test_each_joint_follows_with_its_own_lag():
    robot = EmulatedRobot((0.0, 0.0, 1.0), 0.012, (0.03, 0.06, 0.0))
    assert robot.step((1.0, 1.0, 0.5)) == pytest.approx((1 - math.exp(-0.4), 1 - math.exp(-0.2), 0.5))
    with pytest.raises(ValueError, match="2 lags"):
        EmulatedRobot((0.0,), 0.012, (0.03, 0.03))
