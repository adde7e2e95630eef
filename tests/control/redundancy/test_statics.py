import numpy as np
import pytest

from armgate.control.redundancy.spaces import spaces
from armgate.control.redundancy.statics import balance, torques


def test_virtual_work(case):
    """Check that the power of the torques equals the power of the force for a random motion."""
    J = case.task.jacobian(case.q())
    F, qd = case.rng.normal(size=len(J)), case.rng.normal(size=J.shape[1])
    assert torques(J, F) @ qd == pytest.approx(F @ (J @ qd))


def test_no_force_makes_torque_along_a_self_motion(J):
    """Slide 36: N(J) = R(Jᵀ)⊥."""
    F = np.random.default_rng(3).normal(size=len(J))
    np.testing.assert_allclose(spaces(J).null.T @ torques(J, F), 0.0, atol=1e-12)


def test_a_force_in_a_singular_direction_needs_no_torque(J):
    """Check N(Jᵀ) = R(J)⊥: forces in R(J) need a torque."""
    found = spaces(J)
    for direction in found.singular_directions.T:
        np.testing.assert_allclose(torques(J, direction), 0.0, atol=1e-12)
    for direction in found.range.T:
        assert np.linalg.norm(torques(J, direction)) >= found.sigma[found.rank - 1] * (1.0 - 1e-9)


def test_the_stretched_arm_holds_any_force_along_itself(arm):
    from armgate.control.redundancy.tasks import FrameTask

    J = FrameTask(arm(0.5, 0.4, 0.3), "tip", ("x", "y")).jacobian([0.0, 0.0, 0.0])
    np.testing.assert_allclose(torques(J, [1000.0, 0.0]), 0.0, atol=1e-12)
    np.testing.assert_allclose(torques(J, [0.0, 1.0]), [1.2, 0.7, 0.3])


def test_torques_split_into_a_force_and_an_unbalanced_part(J):
    tau = np.random.default_rng(4).normal(size=J.shape[1])
    split = balance(J, tau)
    np.testing.assert_allclose(torques(J, split.force) + split.inner, tau, atol=1e-12)
    np.testing.assert_allclose(J @ split.inner, 0.0, atol=1e-10)
    np.testing.assert_allclose(spaces(J).singular_directions.T @ split.force, 0.0, atol=1e-10)


def test_a_force_is_recovered_from_its_torques(case):
    J = case.task.jacobian(case.q())
    F = spaces(J).range @ case.rng.normal(size=spaces(J).rank)
    split = balance(J, torques(J, F))
    np.testing.assert_allclose(split.force, F, atol=1e-8)
    np.testing.assert_allclose(split.inner, 0.0, atol=1e-10)


def test_forces_and_torques_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="the force has the shape"):
        torques(np.ones((2, 3)), np.ones(3))
    with pytest.raises(ValueError, match="τ has the shape"):
        balance(np.ones((2, 3)), np.ones(2))
