"""The oracle itself: its kinematics against pinocchio's, its distances against brute force."""

import numpy as np
import pytest

from integrity import scenes
from integrity.oracle import Oracle, segments_apart, step_faults


@pytest.mark.parametrize("name", sorted(scenes.SCENES))
def test_its_kinematics_agree_with_the_model(name):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(0)
    oracle = Oracle(cell)
    qs = [rng.uniform(r.lower, r.upper, (5, r.model.n)) for r in cell.robots]
    R, t = oracle.place(qs)
    for q, robot in zip(qs, cell.robots, strict=True):
        at = [oracle.names.index(f"{robot.name}/{b.name}") for b in robot.model.bodies]
        for k in range(5):
            Rm, tm = robot.model.body_placements(q[k])
            assert np.allclose(R[k, at], Rm, atol=1e-12)
            assert np.allclose(t[k, at], tm, atol=1e-12)


def test_segments_are_as_far_apart_as_their_nearest_points():
    rng = np.random.default_rng(1)
    p, u, q, v = (rng.uniform(-1, 1, (200, 3)) for _ in range(4))
    s = np.linspace(-1, 1, 101)
    a = p[:, None] + s[:, None] * u[:, None]
    b = q[:, None] + s[:, None] * v[:, None]
    brute = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min(axis=(1, 2))
    d = segments_apart(p, u, q, v)
    assert np.all(d <= brute + 1e-12)
    assert np.all(d >= brute - 0.03)


@pytest.mark.parametrize("name", ["duel", "corner", "wire", "tree"])
def test_its_brackets_are_tight_and_below_holds(name):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(2)
    oracle = Oracle(cell)
    qs = [rng.uniform(r.lower, r.upper, (40, r.model.n)) for r in cell.robots]
    R, t = oracle.place(qs)
    low = oracle.below(R, t)
    for k in range(40):
        for pair in range(len(oracle.pairs)):
            apart = oracle.apart(pair, R[k], t[k])
            assert apart.low <= apart.high + 1e-9
            assert low[k, pair] <= apart.high + 1e-7
            if apart.high > 1e-3:
                assert apart.high - apart.low < 1e-4


def test_it_finds_the_one_bad_position_among_many():
    cell = scenes.lane()
    oracle = Oracle(cell)
    xs = np.linspace(-1.0, 0.39, 200)
    good = np.stack([xs, np.zeros(200)], axis=1)
    assert oracle.least([good]).broken == []
    assert oracle.least([good]).margin == pytest.approx(0.01, abs=1e-6)
    bad = good.copy()
    bad[77, 0] = 0.4002
    ((at, pair, d),) = oracle.least([bad]).broken
    assert (at, pair) == (77, 0)
    assert d == pytest.approx(0.0498, abs=1e-6)


def test_it_names_what_a_joint_may_not():
    robot = scenes.lane().robots[0]
    a = 4 * 0.012**2
    q = (0.0, 0.0)
    assert list(step_faults(robot, (0.0, 0.0), (a, 0.0), q)) == []
    assert list(step_faults(robot, (0.0, 0.0), (1.01 * a, 0.0), q)) != []
    assert list(step_faults(robot, (a, 0.0), (-0.01 * a, 0.0), q)) != []
    assert list(step_faults(robot, (0.012, 0.0), (0.0121, 0.0), q)) != []
    assert list(step_faults(robot, (0.0, 0.0), (0.0, 0.0), (2.1, 0.0))) != []
