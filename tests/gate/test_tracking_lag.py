"""Axes that lag differently: the lag tube against simulated drives, and its effect in the gate."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.config.link import EmulatedLinkConfig
from armgate.events import Tick
from armgate.gate.tracking_lag import LargestIncrements, hull_deviation_of, memory
from gate import scenes
from gate.rig import Rig, Traffic
from gate.scripted_gate import ScriptedGate

DEMO = scenes.CONFIGS / "demo.yaml"


def lagging_demo(difference, lag=0.03, **keys):
    """Return the demo cell with a declared difference of its robots' lags, s."""
    config = load_config([DEMO])
    keys |= {"lag_difference": difference, "link": EmulatedLinkConfig(lag=lag)}
    robots = {name: own.model_copy(update=keys) for name, own in config.robots.items()}
    return build_cell(config.model_copy(update={"robots": robots}))


# --- the lag tube -----------------------------------------------------------------------------------------


class Lagging:
    """Joints that follow the same setpoints with lags of their own, in closed form."""

    def __init__(self, q, lags):
        self.q, self.lags = np.array(q), lags

    def after(self, setpoint, time):
        decay = np.array([math.exp(-time / lag) if lag > 0 else 0.0 for lag in self.lags])
        return setpoint + decay * (self.q - setpoint)

    def hold(self, setpoint, time):
        self.q = self.after(setpoint, time)


def setpoints(rng, joints, period, ticks):
    """Return bang-bang, zig-zag, slow and standing stretches, all within 1 rad/s per joint."""
    out, q, u = [], np.zeros(joints), np.zeros(joints)
    while len(out) < ticks:
        if rng.random() < 0.2:
            u = np.zeros(joints) if rng.random() < 0.3 else rng.uniform(-1, 1, joints) * period
            u *= 10.0 ** rng.uniform(-2, 0)
        flips = rng.random() < 0.3
        for _ in range(rng.integers(1, 30)):
            u = -u if flips else u
            q = q + u
            out.append(q)
    return np.array(out[:ticks])


def deviations(rng, lag, difference, period, share, ticks=120):
    """Return the deviation of joints from their companion, at and between ticks, over the largest increment.

    The companion has one lag for all joints, and so stays in the hull of setpoints and its start: it is at a
    weighted mean of them. At each tick it is moved anywhere within ``share`` of the largest increment.
    """
    path = setpoints(rng, 3, period, ticks)
    lags = lag + difference * np.array([-0.5, 0.5, rng.uniform(-0.5, 0.5)])
    steps = np.maximum.accumulate(np.abs(np.diff(path, axis=0, prepend=path[:1])), axis=0)
    true, companion = Lagging(path[0], lags), Lagging(path[0], [lag] * 3)
    at_ticks = between = 0.0
    for setpoint, most in zip(path, np.maximum(steps, 1e-12), strict=True):
        for part in (0.02, 0.1, 0.3, 0.5, 0.7, 0.9):
            off = true.after(setpoint, part * period) - companion.after(setpoint, part * period)
            between = max(between, np.max(np.abs(off) / most))
        true.hold(setpoint, period)
        companion.hold(setpoint, period)
        at_ticks = max(at_ticks, np.max(np.abs(true.q - companion.q) / most))
        companion.q = true.q + share * most * rng.choice((-1.0, 1.0, rng.uniform(-1, 1)), 3)
    return at_ticks, between


@pytest.mark.parametrize(
    ("lag", "difference", "period"),
    [(0.03, 0.0015, 0.012), (0.03, 0.03, 0.012), (0.12, 0.06, 0.012),
     (0.03, 0.003, 0.004), (0.001, 0.0005, 0.012), (0.004, 0.008, 0.012)],
)  # fmt: skip
def test_positions_deviate_by_at_most_the_tube_and_by_at_least_a_third_of_it(lag, difference, period):
    deviation = hull_deviation_of(lagging_demo(difference, lag=lag, period=period).robot("FR"))
    rng = np.random.default_rng(int(1e6 * (lag + difference)))
    at_ticks, between = np.max(
        [deviations(rng, lag, difference, period, deviation.ticks) for _ in range(6)], axis=0
    )
    assert at_ticks <= deviation.ticks + 1e-9
    whole = deviation.ticks + deviation.between
    assert 0.3 * whole <= max(at_ticks, between) <= whole + 1e-9


def test_axes_that_lag_alike_need_no_lag_tube():
    assert hull_deviation_of(lagging_demo(0.0).robot("FR")) is None


def test_a_joint_deviates_by_its_share_of_the_largest_increment_and_its_measurement_noise():
    deviation = hull_deviation_of(lagging_demo(0.006, q_tolerance=1e-5).robot("FR"))
    x = 0.012 / 0.027
    assert deviation.ticks == pytest.approx(0.25)
    assert deviation.between == pytest.approx(0.25 * (x / (1 - math.exp(-x)) - 1))
    assert deviation.noise == pytest.approx(1e-5 * (2 / (1 - math.exp(-0.4)) - 1))
    whole, between = deviation.of((0.01, 0.0))
    assert between == pytest.approx((0.01 * deviation.between, 0.0))
    assert whole == pytest.approx((0.0025 + 0.01 * deviation.between + deviation.noise, 0.0))


@pytest.mark.parametrize("difference", [0.06, 0.2])
def test_a_joint_without_lag_may_be_an_increment_ahead_between_the_ticks(difference):
    deviation = hull_deviation_of(lagging_demo(difference).robot("FR"))
    assert (deviation.ticks, deviation.between) == (difference / 0.024, 1.0)


def test_an_increment_counts_for_twenty_lags_and_the_lag_window():
    assert memory(lagging_demo(0.006).robot("FR")) == math.ceil(20 * 0.033 / 0.012) + 1 == 56
    assert memory(lagging_demo(0.006, lag_window=0.024).robot("FR")) == 58


@pytest.mark.parametrize("ticks", [1, 3, 4, 7, 40])
def test_the_largest_increments_are_kept_for_their_time_plus_at_most_a_quarter(ticks):
    most, rng, given = LargestIncrements(ticks, 2), random.Random(ticks), []
    for _ in range(6 * ticks + 10):
        given.append((rng.uniform(-1, 1) * rng.choice((0.01, 1.0)), rng.uniform(-1, 1)))
        most.add(given[-1])
        least = np.abs(given[-ticks:]).max(axis=0)
        bound = np.abs(given[-5 * math.ceil(ticks / 4) :]).max(axis=0)
        assert all(least <= most.largest)
        assert all(most.largest <= bound)


@pytest.mark.parametrize("ticks", [4, 8, 20])
def test_lasting_increments_still_count_at_the_next_tick(ticks):
    most, rng = LargestIncrements(ticks, 2), random.Random(ticks)
    assert (most.largest, most.lasting) == ((0.0, 0.0), (0.0, 0.0))
    kept = []
    for k in range(6 * ticks):
        lasting = most.lasting
        assert np.all(np.array(lasting) <= most.largest)
        kept.append(lasting == most.largest)
        most.add((rng.uniform(-1, 1) * 0.9**k, rng.uniform(-1, 1)))
        assert np.all(np.array(lasting) <= most.largest)  # a lower bound of the increments added before
    assert not all(kept)


@pytest.mark.parametrize("us", [(5.0, 4.0, 3.0, 2.0), (1.0, 2.0, 3.0, 4.0)])
def test_no_increment_expires_at_the_next_tick_while_the_memory_is_not_full(us):
    most = LargestIncrements(4, 1)
    for count, u in enumerate(us, 1):
        most.add((u,))
        assert most.largest == most.lasting == (max(us[:count]),)


def test_lasting_increments_exclude_the_one_that_expires_at_the_next_tick():
    most = LargestIncrements(4, 1)
    for u in (5.0, 4.0, 3.0, 2.0, 1.0):
        most.add((u,))
    assert (most.largest, most.lasting) == ((5.0,), (4.0,))
    most.add((0.5,))
    assert (most.largest, most.lasting) == ((4.0,), (3.0,))


def test_the_middle_lag_is_between_the_shortest_and_the_longest():
    robot = replace(lagging_demo(0.006).robot("FR"), lags=(0.02, 0.03, 0.04, 0.02, 0.02, 0.02))
    assert hull_deviation_of(robot) == hull_deviation_of(lagging_demo(0.006).robot("FR"))
    assert memory(robot) == memory(lagging_demo(0.006).robot("FR"))


# --- the gate ---------------------------------------------------------------------------------------------


def full_speed(rig, i):
    """Return increments toward random goals, with at least one joint at full speed."""
    robot, player = rig.cell.robots[i], rig.players[i]
    goal = robot.start + 0.4 * np.array(rig.goals[i])
    v = goal - np.array(player.setpoint)
    if np.max(np.abs(v)) < 0.05:
        rig.goals[i] = [rig.rng.uniform(-1, 1) for _ in goal]
    full = robot.velocity * robot.period
    return v / max(1e-9, np.max(np.abs(v) / full))


def runs(cell, lag_spread, seconds, seed=1, lag=0.03):
    rig = Rig(cell, seed, lag=lag, lag_spread=lag_spread)
    rig.goals = [[rig.rng.uniform(-1, 1) for _ in r.start] for r in cell.robots]
    rig.run(full_speed, int(seconds / 0.012) * len(cell.robots))
    return rig


@pytest.mark.daily(1)
@pytest.mark.parametrize("share", [0.01, 0.05])
def test_a_robot_whose_lags_differ_is_faulted_unless_the_difference_is_declared(share):
    assert any("off its stop path" in text for text in runs(lagging_demo(0.0), share, 1.0).tally.violations)
    tally = runs(lagging_demo(share * 0.03), share, 3.0).tally
    assert tally.violations == []
    assert tally.accepted > 0.9


@pytest.mark.slow
def test_the_lag_tube_does_not_stop_a_robot_at_full_speed():
    """With 5 % declared, only a few more commands are refused than without a difference."""
    without, declared = (runs(lagging_demo(d), 0.0, 3.0).tally for d in (0.0, 0.0015))
    assert declared.accepted > without.accepted - 0.03


# --- robots that creep ------------------------------------------------------------------------------------

R = 1e-4


def distance_crept(step, increment, difference=0.1, ticks=60):
    """Return how far a robot creeps across its path, by ``step`` per tick, before its fault; else None."""
    cell = scenes.crossing(window=0.0, tolerance=R, periods=(0.012, 0.012))
    scripted = ScriptedGate(scenes.lagging(cell, 0.03, difference) if difference else cell)
    off = 0.0
    for k in range(ticks):
        before, u, key, index = scripted.q[0], (0.0, 0.0), None, -1
        if any(increment):
            share = min(1.0, 0.2 * (k + 1))
            assert scripted.command(tuple(share * x for x in increment)).outcome == "admitted"
            plan = scripted.held[0]
            u, key, index = plan.increments[0], plan.key, 0
        scripted.tick[0] += 1
        scripted.q[0] = tuple(a + b for a, b in zip(before, u, strict=True))
        off += step if k >= 10 else 0.0
        q = (before[0], before[1] + off)
        number = scripted.tick[0]
        if scripted.gate.step(Tick("fast", number, 0.012 * number, q, scripted.q[0], u, key, index)):
            return abs(off)
    return None


@pytest.mark.parametrize("step", [0.3, 0.9, 1.9, -0.5, -1.9])
@pytest.mark.parametrize("increment", [(0.0, 0.0), (2e-3, 0.0)])
@pytest.mark.parametrize("difference", [0.0, 0.1])
def test_a_joint_at_rest_that_creeps_is_detected_beyond_two_tolerances(step, increment, difference):
    off = distance_crept(step * R, increment, difference)
    assert 2.0 * R < off < (2.0 + abs(step)) * R + 1e-9


@pytest.mark.parametrize("step", [1.0, 1.9, -1.9])
def test_a_robot_that_creeps_off_its_path_while_all_its_joints_move_is_detected(step):
    off = distance_crept(step * R, (2e-3, 2e-3))
    assert off is not None
    assert off < 40.0 * R


# --- time stamps ------------------------------------------------------------------------------------------


@pytest.mark.daily(1)
@pytest.mark.parametrize("seed", range(3))
def test_late_time_stamps_fault_no_robot_with_a_declared_delay(seed):
    """The delay is 15 ms, the period 12 ms, stamps are up to 0.8 periods late, and paths have corners."""
    cell = scenes.crossing(window=0.015, periods=(0.012, 0.012))
    rig = Rig(cell, seed, delay=(0.015, 0.0), traffic=Traffic(jitter=0.8), stops=0.0)
    increment = np.zeros(2)

    def corners(rig, i):
        if rig.rng.random() < 0.3:
            increment[:] = 0.012 * rig.rng.choice((0.05, 0.1, 0.5)) * np.array([rig.rng.uniform(-1, 1), 0.3])
        return increment if i == 0 else None

    assert rig.run(corners, 600).violations == []
