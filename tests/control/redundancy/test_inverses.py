import numpy as np
import pytest

from armgate.control.redundancy.inverses import (
    damped_inverse,
    pseudoinverse,
    variable_damping,
    variably_damped_inverse,
    weighted_pseudoinverse,
)
from armgate.control.redundancy.measures import singular_values
from armgate.control.redundancy.spaces import spaces


def unit_velocities(m: int) -> np.ndarray:
    x = np.random.default_rng(m).normal(size=(m, 4000))
    return x / np.linalg.norm(x, axis=0)


def test_moore_and_penrose(J):
    A, X = J, pseudoinverse(J)
    for left, right in [(A @ X @ A, A), (X @ A @ X, X), ((A @ X).T, A @ X), ((X @ A).T, X @ A)]:
        np.testing.assert_allclose(left, right, atol=1e-10)


def test_the_pseudoinverse_of_full_rank_equals_the_printed_formula(case):
    J = case.task.jacobian(case.q())
    if spaces(J).rank == len(J):
        np.testing.assert_allclose(pseudoinverse(J), J.T @ np.linalg.inv(J @ J.T), atol=1e-8)


def test_joint_speeds_by_the_pseudoinverse_are_at_most_one_over_the_least_singular_value(case):
    """Check the bound of slide 11, and that it is attained."""
    found = spaces(J := case.task.jacobian(case.q()))
    inverse, bound = pseudoinverse(J), 1.0 / found.sigma[found.rank - 1]
    speeds = np.linalg.norm(inverse @ unit_velocities(len(J)), axis=0)
    assert speeds.max() <= bound * (1.0 + 1e-9)
    assert np.linalg.norm(inverse @ found.U[:, found.rank - 1]) == pytest.approx(bound)


def test_joint_speeds_by_the_transpose_are_at_most_the_largest_singular_value(case):
    """Check the bound of slide 11, and that it is attained."""
    found = spaces(J := case.task.jacobian(case.q()))
    speeds = np.linalg.norm(J.T @ unit_velocities(len(J)), axis=0)
    assert speeds.max() <= found.sigma[0] * (1.0 + 1e-12)
    assert np.linalg.norm(J.T @ found.U[:, 0]) == pytest.approx(found.sigma[0])


@pytest.mark.parametrize("k", [1e-3, 0.1, 2.0])
def test_damped_inverse_is_the_printed_one_and_its_norm_is_at_most_one_over_twice_the_damping(J, k):
    m = len(J)
    inverse = damped_inverse(J, k)
    np.testing.assert_allclose(inverse, J.T @ np.linalg.inv(J @ J.T + k * k * np.eye(m)), atol=1e-8 / k**2)
    assert np.linalg.norm(inverse, 2) <= 0.5 / k * (1.0 + 1e-12)


@pytest.mark.parametrize("k", [0.05, 0.7])
def test_damping_adds_k_squared_to_each_eigenvalue(J, k):
    """Slide 13: J* is Jᵀ times the inverse of a matrix whose eigenvalues are those of JJᵀ plus k²."""
    plain = np.linalg.eigvalsh(J @ J.T)
    found = spaces(J)
    damped = []
    for i in range(found.rank):
        u, v = found.U[:, i], found.V[:, i]
        damped.append(found.sigma[i] / (v @ damped_inverse(J, k) @ u))
    np.testing.assert_allclose(np.sort(damped), plain[len(plain) - found.rank :] + k * k, rtol=1e-9)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(J @ J.T + k * k * np.eye(len(J))), plain + k * k, atol=1e-12
    )


def test_damped_inverse_has_the_least_cost(J):
    rng, k = np.random.default_rng(1), 0.3
    xd = rng.normal(size=len(J))

    def cost(qd):
        return np.sum((J @ qd - xd) ** 2) + k * k * np.sum(qd**2)

    best = damped_inverse(J, k) @ xd
    for _ in range(50):
        assert cost(best) <= cost(best + 1e-3 * rng.normal(size=len(best)))


def test_weighted_pseudoinverse(case):
    J = case.task.jacobian(case.q())
    n = J.shape[1]
    w = case.rng.uniform(0.1, 2.0, n)
    root = case.rng.normal(size=(n, n))
    for W_inv, whole in [(w, np.diag(w)), (dense := root @ root.T + np.eye(n), dense)]:
        inverse = weighted_pseudoinverse(J, W_inv)
        np.testing.assert_allclose(J @ inverse @ J, J, atol=1e-9)
        if spaces(J).rank == len(J):
            np.testing.assert_allclose(inverse, whole @ J.T @ np.linalg.inv(J @ whole @ J.T), atol=1e-7)
    np.testing.assert_allclose(weighted_pseudoinverse(J, np.full(n, 3.0)), pseudoinverse(J), atol=1e-9)


def test_a_joint_of_infinite_weight_stands_still():
    J = np.random.default_rng(2).normal(size=(2, 4))
    inverse = weighted_pseudoinverse(J, [1.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(inverse[1], 0.0)
    np.testing.assert_allclose(J @ inverse, np.eye(2), atol=1e-12)


@pytest.mark.parametrize("bad", [[1.0, 1.0], [1.0, -1.0, 1.0], np.zeros((3, 3)), np.ones((2, 2))])
def test_an_invalid_weight_is_refused(bad):
    with pytest.raises(ValueError, match="W⁻¹"):
        weighted_pseudoinverse(np.ones((2, 3)), bad)


def test_variable_damping_sets_in_at_its_threshold_without_a_jump():
    assert variable_damping(0.2, 0.1, 0.05) == variable_damping(0.1, 0.1, 0.05) == 0.0
    assert variable_damping(0.0, 0.1, 0.05) == 0.05
    assert 0.0 < variable_damping(0.1 - 1e-9, 0.1, 0.05) < 1e-4
    assert variable_damping(0.06, 0.1, 1.0) == pytest.approx(0.8)


def test_variably_damped_is_exact_far_from_singularities_and_bounded_in_them(arm):
    from armgate.control.redundancy.tasks import FrameTask

    task = FrameTask(arm(1.0, 1.0), "tip", ("x", "y"))
    far = task.jacobian([0.0, 1.5])
    assert singular_values(far)[-1] > 0.1
    np.testing.assert_array_equal(variably_damped_inverse(far, 0.1, 0.05), pseudoinverse(far))
    for bend in (0.1, 1e-3, 1e-6, 0.0):
        assert np.linalg.norm(variably_damped_inverse(task.jacobian([0.0, bend]), 0.1, 0.05), 2) < 20.0


@pytest.mark.parametrize("k", [0.0, -1.0, np.nan])
def test_zero_damping_is_refused(k):
    with pytest.raises(ValueError, match="damping"):
        damped_inverse(np.eye(2), k)
    with pytest.raises(ValueError, match="damping"):
        variable_damping(0.1, 1.0, k)
