import numpy as np
import pytest

from armgate.cell.errors import ModelError
from armgate.cell.placement import Placement, rotation_from_rpy
from armgate.control.redundancy.tasks import FrameTask, StackedTask, rotation_vector


def test_jacobian_is_the_slope_of_the_error(case, differences):
    """At the target the error's slope is −J, linear and angular rows alike."""
    q = case.q()
    target = case.task.place(q)
    J = -differences(lambda q: case.task.error(q, target), q)
    np.testing.assert_allclose(case.task.jacobian(q), J, atol=1e-8)
    np.testing.assert_array_equal(case.task.error(q, target), np.zeros(case.task.m))


def test_derivative_of_the_jacobian(case, differences):
    for _ in range(3):
        q = case.q()
        np.testing.assert_allclose(
            case.task.jacobian_derivative(q), differences(case.task.jacobian, q), atol=1e-8
        )


def test_rows_may_be_combinations(models, differences):
    S = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.5], [0.0, 0.0, 2.0, 0.0, 1.0, 0.0]])
    task = FrameTask(models["FR"], "tool0", S)
    q = np.array([0.1, -1.2, 1.4, 0.3, 0.2, -0.4])
    np.testing.assert_allclose(task.jacobian(q), S @ models["FR"].frame_jacobian(q, "tool0"), atol=1e-15)
    np.testing.assert_allclose(task.jacobian_derivative(q), differences(task.jacobian, q), atol=1e-8)


def test_stacked_frames(models, differences):
    model = models["branches"]
    parts = [FrameTask(model, "tip", ("x", "y")), FrameTask(model, "right", ("z",))]
    task = StackedTask(parts)
    q = np.array([0.3, -0.4, 0.2, 0.9, -0.7])
    assert task.m == 3
    assert not parts[1].jacobian(q)[:, 1:4].any()
    target = task.place(q)
    np.testing.assert_allclose(task.jacobian(q), -differences(lambda q: task.error(q, target), q), atol=1e-8)
    np.testing.assert_allclose(task.jacobian_derivative(q), differences(task.jacobian, q), atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.5, 2.0, np.pi - 1e-6, np.pi])
def test_rotation_vector(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    found = rotation_vector(R)
    np.testing.assert_allclose(found * np.sign(found @ axis or 1.0), angle * axis, atol=1e-9)


def test_error_leads_to_the_target(models):
    task = FrameTask(models["FR"], "tool0", ("x", "y", "z", "rx", "ry", "rz"))
    here = task.place(models["FR"].lower * 0.0)
    turned = Placement(rotation_from_rpy((0.1, 0.2, 0.3)), np.zeros(3))
    target = Placement(turned.R @ here.R, here.t + np.array([0.1, 0.2, 0.3]))
    error = task.error(np.zeros(6), target)
    np.testing.assert_allclose(error[:3], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(error[3:], rotation_vector(turned.R))


@pytest.mark.parametrize("rows", [(), ("x", "x"), ("x", "w"), np.ones((1, 5)), np.ones(6)])
def test_invalid_rows_are_refused(models, rows):
    with pytest.raises(ValueError, match="expected"):
        FrameTask(models["P"], "tool0", rows)


def test_an_unknown_frame_is_refused(models):
    with pytest.raises(ModelError, match="nowhere"):
        FrameTask(models["P"], "nowhere", ("x",))


def test_tasks_of_two_robots_cannot_be_stacked(models):
    with pytest.raises(ValueError, match="one robot model"):
        StackedTask([FrameTask(models["P"], "tool0", ("x",)), FrameTask(models["FR"], "tool0", ("x",))])
