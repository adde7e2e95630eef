import numpy as np
import pytest

from armgate.control.gains import Gains
from armgate.control.law import CameraLaw
from armgate.control.weights import LimitRule, LimitWeights


def test_against_the_printed_formula():
    """Compare with (10) and (11) as printed: the strength is two over the range, in the unit of the angle."""
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


def half_ranges(fr, x):
    return 0.5 * (fr.upper + fr.lower) + 0.5 * (fr.upper - fr.lower) * x


def test_the_printed_formula_in_both_units(fr):
    """Check that both readings differ: A1, ±185°, at half of its half range has the weight 0.17 or 0.998."""
    x = np.full(6, 0.5)
    rad, deg = (
        LimitWeights.of(fr.model, rule, 1.0).inverse(x)[0]
        for rule in (LimitRule.PAPER_RADIANS, LimitRule.PAPER_DEGREES)
    )
    span = np.degrees(fr.upper[0] - fr.lower[0])
    assert rad == pytest.approx(1.0 / (1.0 + (16.0 / np.radians(span) * 0.5 / 0.75**2) ** 2))
    assert deg == pytest.approx(1.0 / (1.0 + (16.0 / span * 0.5 / 0.75**2) ** 2))
    assert rad < 0.2 < 0.99 < deg


def test_chan_and_dubey_weigh_by_the_gradient_of_their_potential(fr, differences):
    """W = 1 + |∂/∂q of ¼ (q_M − q_m)² / ((q_M − q)(q − q_m))|."""
    q = half_ranges(fr, np.array([-0.9, -0.5, 0.1, 0.4, 0.8, 0.95]))
    weights = LimitWeights.of(fr.model, LimitRule.CHAN_DUBEY, 1.0)

    def potential(at):
        return (0.25 * (fr.upper - fr.lower) ** 2 / ((fr.upper - at) * (at - fr.lower))).sum()

    expected = 1.0 / (1.0 + np.abs(differences(potential, q)))
    np.testing.assert_allclose(weights.inverse(weights.position(q)), expected, rtol=1e-6)


def test_prismatic_ranges_are_in_metres(cell):
    model = cell.robot("GR").model
    rad, deg = (rule.strengths(model, 1.0) for rule in (LimitRule.PAPER_RADIANS, LimitRule.PAPER_DEGREES))
    slides = np.array([joint.kind == "prismatic" for joint in model.joints])
    np.testing.assert_allclose(rad / deg, np.where(slides, 1.0, 180.0 / np.pi))


@pytest.mark.parametrize("rule", LimitRule)
def test_a_joint_that_leaves_its_limit_is_held_only_by_the_papers_rule(fr, rule):
    law = CameraLaw(fr.model, "camera", Gains(limits=rule, distance=0.0, roll=0.0))
    free = CameraLaw(fr.model, "camera", Gains(limit=1e-9, distance=0.0, roll=0.0))
    q = np.array(fr.start)
    q[0] = half_ranges(fr, np.full(6, 0.999))[0]
    at = fr.model.frame(q, "camera")
    goal = [at.t + at.R[:, 2] + step * at.R[:, 1] for step in (-0.3, 0.3)]
    leaving = min(goal, key=lambda p: free(q, free.goal(p, 1.0))[0])
    ours, wanted = (one(q, one.goal(leaving, 1.0))[0] for one in (law, free))
    assert wanted < -0.1
    held = abs(ours) < 0.1 * abs(wanted)
    assert held == rule.always
