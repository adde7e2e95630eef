"""Availability: safe motion is admitted, and robots come as near as they may."""

import random

import numpy as np
import pytest

from armgate.events import Outcome
from gate import scenes
from gate.oracle import Oracle
from gate.rig import Rig


def test_free_motion_is_always_admitted():
    rig = Rig(scenes.lane(), stops=0.0, lag=0.03)
    robot = rig.cell.robots[0]
    rng, goal = random.Random(1), {}

    def controller(rig, i):
        q = np.array(rig.players[i].setpoint)
        if rng.random() < 0.05 or not goal:
            goal[0] = np.array([rng.uniform(-1.9, -0.5), rng.uniform(-1.9, 1.9)])
        return bounded(robot, rig.players[i].last, (goal[0] - q) * 0.05)

    rig.run(controller, 400)
    assert rig.tally.admitted == rig.tally.commands
    assert rig.tally.violations == []


def bounded(robot, last, u):
    """Return increments of a controller that keeps the robot's bounds by itself."""
    T = robot.period
    v, a = robot.velocity * T, np.minimum(robot.acceleration, robot.deceleration) * T * T
    return np.clip(np.clip(u, np.array(last) - 0.9 * a, np.array(last) + 0.9 * a), -v, v)


def test_free_motion_of_the_demo_cell_is_always_admitted():
    rig = Rig(scenes.demo(), stops=0.0, lag=0.03)

    def controller(rig, i):
        robot = rig.cell.robots[i]
        aim = robot.start + 0.15 * np.sin(1.3 * rig.now + np.arange(robot.model.n))
        return bounded(robot, rig.players[i].last, (aim - np.array(rig.players[i].setpoint)) * 0.05)

    rig.run(controller, 150)
    assert rig.tally.admitted == rig.tally.commands
    assert rig.tally.violations == []


SHAPES = {
    "ball": scenes.body("sphere", 0.05),
    "bar": scenes.body("box", 0.2, 0.1, 0.06, rpy=(0.2, 0.3, 0.1)),
    "drum": scenes.body("cylinder", 0.05, 0.2, rpy=(0.4, 1.0, 0.0)),
}


@pytest.mark.daily(5)
@pytest.mark.parametrize(
    ("period", "response", "reach"),
    [(0.012, "stop", 2.5e-3), (0.004, "stop", 0.5e-3), (0.012, "slow", 0.2e-3), (0.004, "slow", 0.2e-3)],
)
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_a_straight_approach_at_full_speed_ends_near_the_stop_distance(period, response, reach, shape):
    start = [np.array([-0.1, 0.0])]
    rig = Rig(scenes.lane(period, response, SHAPES[shape]), stops=0.0, lag=0.01, start=start)
    for _ in range(500):
        rig.step(lambda rig, i: (rig.cell.robots[i].velocity[0] * period, 0.0))
    rig.rest()
    least = rig.oracle.least([d.q[None, :] for d in rig.drives])
    assert 0.0 <= least.margin <= reach
    assert rig.tally.violations == []


@pytest.mark.daily(1)
@pytest.mark.parametrize("share", [0.1, 0.45, 0.8])
def test_two_robots_working_apart_are_never_refused(share):
    """They are at least 0.3 m apart: each turns and bends on its own side."""
    rig = Rig(scenes.duel(gap=1.9), stops=0.0, lag=0.03)
    center = {0: np.array([0.0, -0.3, 0.6, 0.0]), 1: np.array([0.0, -0.3, 0.6, 0.0])}
    refused = []

    def controller(rig, i):
        robot = rig.cell.robots[i]
        wave = 0.12 * np.sin(np.array([6.0, 4.5, 6.5, 8.0]) * rig.now + i)
        v = center[i] + wave - np.array(rig.players[i].setpoint)
        u = bounded(robot, rig.players[i].last, v * 0.06)
        return np.clip(u, -share * robot.velocity * robot.period, share * robot.velocity * robot.period)

    near, fastest = np.inf, 0.0
    between = [k for k, p in enumerate(rig.cell.pairs) if p.kind == "robots"]
    for k in range(1500 if share < 0.2 else 500):
        rig.step(controller)
        for robot, player in zip(rig.cell.robots, rig.players, strict=True):
            fastest = max(fastest, float(np.max(np.abs(player.last) / (robot.velocity * robot.period))))
        if k % 10 == 0:
            R, t = rig.oracle.place([d.q[None, :] for d in rig.drives])
            near = min(near, *(rig.oracle.apart(p, R[0], t[0]).low for p in between))
        refused += [v for v in rig.last_verdict if v is not None and v.outcome is Outcome.REFUSED]
    assert refused == []
    assert fastest == pytest.approx(share)
    assert near < 0.3


def violated(cell, oracle, q):
    R, t = oracle.place(q)
    low = oracle.below(R, t)[0]
    out = {}
    for p in np.flatnonzero(low < oracle.limits):
        d = oracle.apart(int(p), R[0], t[0])
        if d.high < oracle.limits[p]:
            out[int(p)] = d.low
    return out


def test_a_retreat_admits_increments_that_widen_all_violated_margins():
    """The starts violate clearances by up to an overlap of 3 cm; the increments cause no new violation."""
    cell = scenes.planar()
    oracle, rng = Oracle(cell), random.Random(5)
    robot = cell.robots[0]
    commands = admitted = 0
    while commands < 60:
        q = np.array([rng.uniform(a, b) for a, b in zip(robot.lower, robot.upper, strict=True)])
        before = violated(cell, oracle, [q[None, :]])
        if not before or min(before.values()) < -0.03:
            continue
        u = robot.acceleration * robot.period**2 * np.array([rng.uniform(-1, 1) for _ in q])
        R, t = oracle.place([np.array([q, q + u, q + 2 * u])])
        after = violated(cell, oracle, [(q + u)[None, :]])
        widened = all(oracle.apart(p, R[1], t[1]).low > d + 1e-5 for p, d in before.items())
        if not widened or set(after) - set(before):
            continue
        rig = Rig(cell, commands, stops=0.0, start=[q], oracle=oracle)
        commands += 1
        admitted += rig.command(0, u).outcome is not Outcome.REFUSED
    assert admitted >= 0.95 * commands


@pytest.mark.daily(1)
@pytest.mark.parametrize("scene", ["planar", "wire"])
def test_a_retreat_leaves_the_violation(scene):
    """From most starts in violation, moving in the direction that widens most ends the violation."""
    cell = scenes.SCENES[scene]()
    oracle, rng, robot = Oracle(cell), random.Random(2), cell.robots[0]
    tried = out = 0
    while tried < 4:
        q = np.array([rng.uniform(a, b) for a, b in zip(robot.lower, robot.upper, strict=True)])
        deep = violated(cell, oracle, [q[None, :]])
        if len(deep) != 1 or min(deep.values()) < -0.02:
            continue
        (pair,) = deep
        tried += 1
        rig = Rig(cell, tried, stops=0.0, start=[q], oracle=oracle)

        def controller(rig, i, pair=pair):
            x = np.array(rig.players[i].setpoint)
            steps = np.concatenate([np.eye(len(x)), -np.eye(len(x))]) * 1e-3
            R, t = oracle.place([np.concatenate([x[None, :], x + steps])])
            d = np.array([oracle.apart(pair, R[k], t[k]).low for k in range(len(R))])
            slope = np.array([d[1 + j] - d[1 + len(x) + j] for j in range(len(x))])
            return 0.3 * robot.velocity * robot.period * slope / max(np.max(np.abs(slope)), 1e-12)

        for _ in range(300):
            rig.step(controller)
            if not violated(cell, oracle, [np.array(rig.players[0].setpoint)[None, :]]):
                out += 1
                break
        rig.check()
        assert rig.tally.violations == []
    assert out >= tried - 1
