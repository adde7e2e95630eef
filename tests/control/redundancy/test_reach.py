import numpy as np
import pytest

from armgate.cell.placement import Placement
from armgate.control.redundancy.objectives import TowardsCentre
from armgate.control.redundancy.reach import Method, Reach, Tuning
from armgate.control.redundancy.tasks import FrameTask

T = 0.012


def run(reach, q, seconds):
    """Return positions and errors of the controller with an ideal robot."""
    qs, errors = [q], []
    for _ in range(round(seconds / T)):
        answer = reach.velocity(qs[-1])
        qs.append(qs[-1] + T * answer.qd)
        errors.append(np.linalg.norm(answer.error))
    return np.array(qs), np.array(errors)


@pytest.mark.parametrize("method", Method)
def test_every_method_arrives(method, models):
    task = FrameTask(models["P"], "tool0", ("x", "y"))
    target = Placement.from_rpy([0.3, 0.7, 0.5], [0.0, 0.0, 0.0])
    _, errors = run(Reach(task, target, Tuning(method)), np.array([0.0, 0.8, 0.8]), 25.0)
    assert errors[0] > 0.1
    assert errors[-1] < 1e-4
    assert (np.diff(errors) < 1e-9).all()


def test_the_tool_keeps_its_speed_and_moves_straight(models):
    task = FrameTask(models["P"], "tool0", ("x", "y"))
    target = Placement.from_rpy([0.3, 0.7, 0.5], [0.0, 0.0, 0.0])
    qs, _ = run(Reach(task, target, Tuning(Method.PSEUDO, speed=0.1)), np.array([0.0, 0.8, 0.8]), 6.0)
    places = np.array([task.place(q).t for q in qs])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / T
    assert speeds.max() == pytest.approx(0.1, rel=0.01)
    way = places - places[0]
    along = way[-1] / np.linalg.norm(way[-1])
    assert np.linalg.norm(way - np.outer(way @ along, along), axis=1).max() < 1e-3


@pytest.mark.parametrize("method", [Method.DAMPED, Method.VARIABLE, Method.TRANSPOSE])
def test_a_target_out_of_reach_is_approached_within_the_speed(method, models):
    """The pseudoinverse would cause huge joint speeds here; these methods stretch the arm and rest."""
    task = FrameTask(models["P"], "tool0", ("x", "y"))
    target = Placement.from_rpy([1.5, 0.0, 0.5], [0.0, 0.0, 0.0])
    qs, errors = run(Reach(task, target, Tuning(method)), np.array([0.3, 0.4, 0.5]), 30.0)
    assert errors[-1] == pytest.approx(0.3, abs=1e-2)
    assert np.abs(np.diff(qs, axis=0) / T).max() < 4.0
    assert np.abs(qs[-1] - qs[-80]).max() < 0.02


@pytest.mark.parametrize("method", Method)
def test_objectives_do_not_disturb_the_task(method, models):
    model = models["P"]
    task = FrameTask(model, "tool0", ("x", "y"))
    q = np.array([0.0, 0.8, 0.8])
    target = Placement.from_rpy([0.3, 0.7, 0.5], [0.0, 0.0, 0.0])
    centre = TowardsCentre(model.lower, model.upper)
    plain = Reach(task, target, Tuning(method)).velocity(q).qd
    both = Reach(task, target, Tuning(method), [(centre, 1.0)]).velocity(q).qd
    J = task.jacobian(q)
    assert np.abs(J @ (both - plain)).max() < 1e-12
    assert np.linalg.norm(both - plain) > 0.01


def test_in_space_with_orientation(models):
    model = models["FR"]
    task = FrameTask(model, "tool0", ("x", "y", "z", "rx", "ry", "rz"))
    start = np.array([0.1, -1.4, 1.6, 0.3, -0.6, 0.2])
    goal = start + np.array([0.3, 0.2, -0.2, 0.4, 0.3, -0.5])
    _, errors = run(Reach(task, task.place(goal), Tuning(Method.VARIABLE)), start, 10.0)
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("name", ["gain", "speed", "damping", "threshold"])
def test_numbers_must_be_positive(name):
    with pytest.raises(ValueError, match=name):
        Tuning(**{name: 0.0})


def test_a_joint_at_its_limit_is_locked_and_the_others_take_over(models):
    model = models["P"]
    task = FrameTask(model, "tool0", ("x", "y"))
    q = np.array([0.3, 2.6, 0.5])
    # Along this direction the second joint would continue to turn.
    target = task.place(q + np.array([0.0, 0.2, 0.1]))
    free = Reach(
        task, target, Tuning(Method.PSEUDO, speed=9.0), limits=(model.lower - 9.0, model.upper + 9.0)
    )
    locked = Reach(task, target, Tuning(Method.PSEUDO, speed=9.0))
    assert free.velocity(q).qd[1] > 0.01
    answer = locked.velocity(q)
    assert answer.qd[1] == 0.0
    np.testing.assert_allclose(task.jacobian(q) @ answer.qd, 2.0 * answer.error, atol=1e-12)


@pytest.mark.parametrize("method", Method)
def test_no_joint_is_pushed_against_its_limit(method, models):
    model = models["GR"]
    task = FrameTask(model, "tool0", ("x", "y", "z"))
    rng = np.random.default_rng(4)
    middle = TowardsCentre(model.lower, model.upper)
    pressed = 0
    for _ in range(40):
        q = rng.uniform(model.lower, model.upper)
        side = rng.integers(3, size=model.n)
        q = np.where(side == 0, model.lower, np.where(side == 1, model.upper, q))
        place = Placement(np.eye(3), task.place(q).t + rng.normal(size=3))
        answer = Reach(task, place, Tuning(method), [(middle, 0.1)]).velocity(q)
        assert not ((answer.qd < 0.0) & (side == 0)).any()
        assert not ((answer.qd > 0.0) & (side == 1)).any()
        pressed += int(((answer.qd == 0.0) & (side < 2)).any())
    assert pressed > 20
