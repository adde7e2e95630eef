import numpy as np
import pytest

from armgate.control.redundancy.inverses import damped_inverse
from armgate.control.redundancy.resolution import null_space_part, resolve
from armgate.control.redundancy.spaces import spaces


def kkt(J, xd, wanted, W):
    """Solve stationarity and constraint of slide 39 as one linear system."""
    m, n = J.shape
    system = np.block([[W, -J.T], [J, np.zeros((m, m))]])
    return np.linalg.solve(system, np.concatenate([W @ wanted, xd]))[:n]


def test_solves_the_constrained_least_squares_problem(redundant):
    J = redundant.task.jacobian(redundant.q())
    m, n = J.shape
    xd, wanted, w = (
        redundant.rng.normal(size=m),
        redundant.rng.normal(size=n),
        redundant.rng.uniform(0.2, 2.0, n),
    )
    np.testing.assert_allclose(resolve(J, xd, wanted), kkt(J, xd, wanted, np.eye(n)), atol=1e-9)
    np.testing.assert_allclose(resolve(J, xd, wanted, w), kkt(J, xd, wanted, np.diag(1.0 / w)), atol=1e-8)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_wanted_velocity_does_not_move_the_task(redundant, weighted):
    for _ in range(20):
        J = redundant.task.jacobian(redundant.q())
        m, n = J.shape
        wanted, W_inv = redundant.rng.normal(size=n), redundant.rng.uniform(0.2, 2.0, n) if weighted else None
        qd = resolve(J, np.zeros(m), wanted, W_inv)
        assert np.abs(J @ qd).max() < 1e-10
        assert np.linalg.norm(qd) > 1e-6
        xd = redundant.rng.normal(size=m)
        assert np.abs(J @ resolve(J, xd, wanted, W_inv) - xd).max() < 1e-10


def test_null_space_part_is_the_orthogonal_projection(J):
    wanted = np.random.default_rng(5).normal(size=J.shape[1])
    part = null_space_part(J, wanted)
    assert np.abs(J @ part).max() < 1e-10
    np.testing.assert_allclose(part, spaces(J).null_projector @ wanted, atol=1e-10)
    np.testing.assert_allclose(null_space_part(J, part), part, atol=1e-10)


def test_in_a_singularity_the_reachable_part_of_the_task_is_kept(arm):
    from armgate.control.redundancy.tasks import FrameTask

    J = FrameTask(arm(0.5, 0.4, 0.3), "tip", ("x", "y")).jacobian([0.0, 0.0, 0.0])
    qd = resolve(J, [1.0, 1.0], [0.3, -0.2, 0.1])
    np.testing.assert_allclose(J @ qd, [0.0, 1.0], atol=1e-12)


def test_a_projector_of_the_damped_inverse_would_disturb_the_task():
    J = np.random.default_rng(6).normal(size=(2, 4))
    leaks = np.eye(4) - damped_inverse(J, 0.5) @ J
    assert np.abs(J @ leaks).max() > 0.01


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="ẋ has the shape"):
        resolve(np.ones((2, 3)), np.ones(3), np.ones(3))
    with pytest.raises(ValueError, match="q̇₀ has the shape"):
        resolve(np.ones((2, 3)), np.ones(2), np.ones(2))
