import numpy as np
import pytest

from armgate.control.weights import LimitWeights


def test_against_the_printed_formula():
    """(10) and (11): printed, the strength is two over the range, in the unit of the angle."""
    lower, upper = np.radians([-155.0]), np.radians([35.0])
    q = np.linspace(lower[0] + 1e-3, upper[0] - 1e-3, 101)
    span = upper[0] - lower[0]
    H = span**2 * (2 * q - upper[0] - lower[0]) / ((q - upper[0]) ** 2 * (q - lower[0]) ** 2)
    weights = LimitWeights(lower, upper, 2.0 / span)
    ours = [weights.inverse(weights.position(np.array([at])))[0] for at in q]
    np.testing.assert_allclose(ours, 1.0 / (1.0 + H**2), rtol=1e-9)


def test_the_unit_of_the_angle_does_not_matter():
    q = np.linspace(-0.99, 0.99, 11)
    in_rad = LimitWeights(np.full(11, -1.0), np.full(11, 1.0), 0.02)
    in_deg = LimitWeights(np.degrees(np.full(11, -1.0)), np.degrees(np.full(11, 1.0)), 0.02)
    np.testing.assert_allclose(
        in_rad.inverse(in_rad.position(q)), in_deg.inverse(in_deg.position(np.degrees(q))), rtol=1e-10
    )


def test_ends_and_middle():
    weights = LimitWeights(np.zeros(5), np.full(5, 2.0), 0.02)
    x = weights.position(np.array([-0.5, 0.0, 1.0, 2.0, 2.5]))
    np.testing.assert_allclose(x, [-1.5, -1.0, 0.0, 1.0, 1.5])
    np.testing.assert_array_equal(weights.inverse(x), [0.0, 0.0, 1.0, 0.0, 0.0])


def test_weights_without_strength_are_refused():
    with pytest.raises(ValueError, match="c > 0"):
        LimitWeights(np.zeros(1), np.ones(1), 0.0)


def test_a_joint_without_range_is_refused():
    with pytest.raises(ValueError, match="lower < upper"):
        LimitWeights(np.zeros(2), np.array([1.0, 0.0]), 0.02)
