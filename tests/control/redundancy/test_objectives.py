"""Objectives: exact gradients; each lowers its potential without moving the task."""

from itertools import pairwise

import numpy as np
import pytest

from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Cylinder, Sphere
from armgate.control.redundancy.measures import manipulability
from armgate.control.redundancy.objectives import (
    AwayFromObstacles,
    AwayFromSingularities,
    Obstacle,
    TowardsCentre,
    wanted_velocity,
)
from armgate.control.redundancy.resolution import null_space_part
from armgate.control.redundancy.tasks import FrameTask


def obstacles_near(model):
    """Return shapes beside the middle of the robot, near enough to have an effect at most positions."""
    rng = np.random.default_rng(9)
    q = 0.5 * (model.lower + model.upper)
    centre = model.frame(q, "tool0").t * 0.6
    shapes = [Sphere(0.1), Box(0.2, 0.3, 0.4), Cylinder(0.1, 0.5)]
    offsets = rng.normal(scale=0.4, size=(3, 3))
    places = [Placement.from_rpy(centre + offset, rng.normal(size=3)) for offset in offsets]
    return [Obstacle(shape, place) for shape, place in zip(shapes, places, strict=True)]


OBJECTIVES = {
    "singularities": (AwayFromSingularities, 2.0),
    "limits": (lambda task: TowardsCentre(task.model.lower, task.model.upper), 1.0),
    "obstacles": (lambda task: AwayFromObstacles(task.model, obstacles_near(task.model), 5.0), 0.05),
}


@pytest.fixture(params=OBJECTIVES)
def build(request):
    return OBJECTIVES[request.param][0]


@pytest.fixture(params=["planar-xy", "arm-xyz", "gantry-all"])
def task(request, models):
    robot, rows = {
        "planar-xy": ("P", ("x", "y")),
        "arm-xyz": ("FR", ("x", "y", "z")),
        "gantry-all": ("GR", ("x", "y", "z", "rx", "ry", "rz")),
    }[request.param]
    return FrameTask(models[robot], "tool0", rows)


def positions(model, count, seed=0):
    rng = np.random.default_rng(seed)
    low, high = 0.9 * model.lower + 0.1 * model.upper, 0.1 * model.lower + 0.9 * model.upper
    return rng.uniform(low, high, (count, model.n))


def test_gradient(task, build, differences):
    objective = build(task)
    for q in positions(task.model, 8):
        expected = differences(objective.potential, q)
        assert np.abs(expected).max() > 1e-6
        np.testing.assert_allclose(
            objective.gradient(q), expected, atol=1e-6 * (1.0 + np.abs(expected).max())
        )


@pytest.mark.parametrize("name", OBJECTIVES)
def test_an_objective_lowers_its_potential_without_moving_the_task(task, name):
    objective, gain = OBJECTIVES[name][0](task), OBJECTIVES[name][1]
    moved = 0
    for q in positions(task.model, 6, seed=1):
        J = task.jacobian(q)
        qd = null_space_part(J, wanted_velocity([(objective, gain)], q))
        assert np.abs(J @ qd).max() < 1e-10
        slope = objective.gradient(q) @ qd
        assert slope <= 0.0
        if np.linalg.norm(qd) > 1e-4:
            moved += 1
            h = 1e-4 / np.linalg.norm(qd)
            assert objective.potential(q + h * qd) < objective.potential(q)
    assert moved >= 5


@pytest.mark.parametrize("name", OBJECTIVES)
def test_an_objective_ends_at_a_lower_potential_with_the_task_in_place(task, name):
    objective, gain = OBJECTIVES[name][0](task), OBJECTIVES[name][1]
    q = positions(task.model, 1, seed=2)[0]
    place, potentials = task.place(q), [objective.potential(q)]
    for _ in range(150):
        J = task.jacobian(q)
        qd = null_space_part(J, wanted_velocity([(objective, gain)], q))
        qd += np.linalg.pinv(J) @ (5.0 * task.error(q, place))
        q = q + 0.02 * qd / max(1.0, np.linalg.norm(qd))
        potentials.append(objective.potential(q))
    assert potentials[-1] < potentials[0] - 1e-4
    assert all(after <= before + 1e-5 for before, after in pairwise(potentials))
    assert np.abs(task.error(q, place)).max() < 1e-3


def test_the_objective_leads_out_of_a_singularity(models):
    task = FrameTask(models["P"], "tool0", ("x", "y"))
    objective = AwayFromSingularities(task)
    q = np.array([0.3, 0.0, 0.0])
    gradient = objective.gradient(q)
    assert objective.potential(q) == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(gradient) > 0.1
    assert manipulability(task.jacobian(q - 1e-3 * gradient)) > 1e-5


def test_every_joint_returns_to_the_middle_at_the_same_rate():
    objective = TowardsCentre([-1.0, 0.0], [3.0, 0.1])
    assert objective.potential([1.0, 0.05]) == 0.0
    np.testing.assert_allclose(wanted_velocity([(objective, 2.0)], np.array([2.0, 0.0])), [-2.0, 0.1])
    with pytest.raises(ValueError, match="lower < upper"):
        TowardsCentre([0.0], [0.0])


def test_far_obstacles_have_no_effect(models):
    model = models["P"]
    far = Obstacle(Sphere(0.1), Placement.from_rpy([9.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
    objective = AwayFromObstacles(model, [far], 0.5)
    assert objective.potential(np.zeros(3)) == 0.0
    np.testing.assert_array_equal(objective.gradient(np.zeros(3)), 0.0)
    assert AwayFromObstacles(model, [], 0.5).least_distance(np.zeros(3)) == np.inf


def test_the_least_distance_at_a_known_position(models):
    """The arm lies along x at z = 0.5; its last link ends in a cap of 30 mm at x = 1.17 + 0.03."""
    ball = Obstacle(Sphere(0.1), Placement.from_rpy([2.0, 0.0, 0.5], [0.0, 0.0, 0.0]))
    objective = AwayFromObstacles(models["P"], [ball], 0.5)
    assert 0.65 < objective.least_distance(np.zeros(3)) <= 0.7 + 1e-9


def test_a_reach_of_zero_is_refused(models):
    with pytest.raises(ValueError, match="reach"):
        AwayFromObstacles(models["P"], [], 0.0)
