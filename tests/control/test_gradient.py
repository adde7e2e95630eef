import numpy as np
import pytest

from armgate.control.gradient import DAMPING, limited_gradient, weighted_gradient
from armgate.control.weights import LimitWeights


@pytest.fixture(params=range(10))
def rng(request):
    return np.random.default_rng(request.param)


def test_equals_the_printed_law(rng):
    """(9) with its pseudoinverse (7) and projector written out."""
    J_t, F, w = rng.normal(size=(2, 6)), rng.normal(size=6), rng.uniform(0.05, 1.0, 6)
    psi, k_p = rng.normal(size=2), 5.0
    W_inv = np.diag(w)
    J_w = W_inv @ J_t.T @ np.linalg.inv(J_t @ W_inv @ J_t.T)
    printed = -k_p * J_w @ psi + (np.eye(6) - J_w @ J_t) @ W_inv @ F
    qd = weighted_gradient(np.vstack((J_t, F)), tuple(-k_p * psi), w, 0.5)
    np.testing.assert_allclose(qd, printed, rtol=1e-9, atol=1e-12)


def test_joint_speeds_are_bounded_if_the_weights_of_all_joints_are_small(rng):
    M = rng.normal(size=(3, 6))
    for scale in (1e-3, 1e-6, 0.0):
        qd = weighted_gradient(M, (1.0, -1.0), np.full(6, scale), 0.5)
        assert np.isfinite(qd).all()
        assert np.abs(qd).max() < scale * 50.0 / DAMPING**2 + 1e-300


def test_only_approaching_joints_are_weighted(rng):
    M, rate, x = rng.normal(size=(3, 6)), (0.4, -0.3), rng.uniform(-0.99, 0.99, 6)
    weights = LimitWeights(-np.ones(6), np.ones(6), 0.02)
    w = weights.inverse(x)
    qd = limited_gradient(M, rate, *weights.directed(x, always=False), steepness=0.5)
    used = np.where(qd * x > 0.0, w, 1.0)
    assert np.allclose(qd, weighted_gradient(M, rate, used, 0.5)) or (used[qd * x <= 0.0] == 1.0).all()
    np.testing.assert_allclose(M[:2] @ qd, rate, rtol=1e-6)


def test_a_joint_leaves_its_limit_without_weighting():
    M = np.zeros((3, 6))
    M[0, 0] = M[1, 1] = 1.0
    M[2, 2] = -1.0
    x = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    ways = LimitWeights(-np.ones(6), np.ones(6), 0.02).directed(x, always=False)
    assert limited_gradient(M, (0.0, 0.0), *ways, steepness=0.5)[2] == -1.0
    M[2, 2] = 1.0
    assert limited_gradient(M, (0.0, 0.0), *ways, steepness=0.5)[2] == 0.0


def test_a_joint_weighted_in_both_directions_stands_still(rng):
    M, ways = rng.normal(size=(3, 6)), np.ones(6)
    ways[1] = 0.0
    qd = limited_gradient(M, (0.4, -0.3), ways, ways, steepness=0.5)
    assert qd[1] == 0.0
    np.testing.assert_allclose(M[:2] @ qd, (0.4, -0.3), rtol=1e-9)
