"""Steering: speed, acceleration and joint limits; every motion ends at rest."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.apps.errors import AppError
from armgate.apps.lead.motions import JointRate, JointTarget, ToolTarget, ToolTwist
from armgate.apps.lead.shaping import Bounds
from armgate.apps.lead.steering import TOOL_SPEED, Steering
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.placement import Placement
from armgate.control.redundancy.tasks import ROWS, FrameTask

CONFIG = Path(__file__).parents[2] / "configs" / "demo.yaml"
T = 0.012
N = 3
BOUNDS = Bounds(np.array([1.0, 2.0, 0.5]), np.array([4.0, 8.0, 2.0]), np.array([2.0, np.inf, 2.0]), T)
LOWER, UPPER = np.array([-1.0, -2.0, -0.1]), np.array([1.0, 2.0, 0.1])
EPS = 1e-12


def joints(share=1.0):
    return Steering(BOUNDS, LOWER, UPPER, share)


def driven(steering, motions, start=None):
    """Return increments and setpoints of a robot that plays every increment."""
    setpoint, last, found = np.zeros(N) if start is None else start, np.zeros(N), []
    for motion in motions:
        last = steering.step(motion, setpoint, last)
        setpoint = setpoint + last
        found.append((last, setpoint))
    return found


shares = st.lists(st.floats(-3.0, 3.0), min_size=N, max_size=N).map(lambda x: JointRate(np.array(x)))
targets = st.lists(st.floats(-3.0, 3.0), min_size=N, max_size=N).map(lambda x: JointTarget(np.array(x)))
phases = st.lists(st.tuples(shares | targets | st.none(), st.integers(1, 60)), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(phases, st.floats(0.1, 1.0))
def test_any_sequence_of_motions_keeps_the_bounds_and_comes_to_rest(phases, share):
    motions = [motion for motion, ticks in phases for _ in range(ticks)] + [None] * 60
    before = np.zeros(N)
    for dq, setpoint in driven(joints(share), motions):
        assert np.all(np.abs(dq) <= share * BOUNDS.increment + EPS)
        change = np.abs(dq) - np.abs(before)
        slowing = (dq * before >= 0.0) & (change < 0.0)
        assert np.all(np.abs(dq - before)[~slowing] <= BOUNDS.gain[~slowing] + EPS)
        slowest = np.minimum(BOUNDS.gain, np.minimum(BOUNDS.acceleration, BOUNDS.deceleration) * T * T)
        assert np.all(-change[slowing] <= slowest[slowing] + EPS)
        assert np.all((setpoint >= LOWER - EPS) & (setpoint <= UPPER + EPS))
        before = dq
    assert np.all(before == 0.0)


def test_a_joint_reaches_its_share_of_the_speed_and_stops_short_of_its_limit():
    found = driven(joints(0.5), [JointRate(np.array([1.0, 0.0, 0.0]))] * 400)
    assert max(dq[0] for dq, _ in found) == pytest.approx(0.5 * BOUNDS.increment[0])
    assert found[-1][1][0] == pytest.approx(UPPER[0], abs=1e-3)


def test_a_target_is_reached_and_clipped_to_the_limits():
    setpoint = driven(joints(), [JointTarget(np.array([0.5, -1.0, 7.0]))] * 600)[-1][1]
    assert setpoint == pytest.approx([0.5, -1.0, UPPER[2]], abs=1e-4)


def test_a_joint_outside_its_limits_may_only_return():
    start = np.array([1.5, 0.0, 0.0])
    assert driven(joints(), [JointRate(np.ones(N))] * 50, start)[-1][1][0] == 1.5
    assert driven(joints(), [JointRate(-np.ones(N))] * 50, start)[-1][1][0] < 1.4


def test_without_the_cells_libraries_a_tool_is_refused_by_name():
    with pytest.raises(AppError, match="move its joints"):
        joints().step(ToolTwist(np.ones(6)), np.zeros(N), np.zeros(N))


# --- the tool ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fr():
    return build_cell(load_config([CONFIG])).robot("FR")


@pytest.fixture
def arm(fr):
    """Return the steering of the demo cell's follower, its task and a start."""
    bounds = Bounds(fr.velocity, fr.acceleration, fr.deceleration, fr.period)
    task = FrameTask(fr.model, fr.tool, ROWS)
    bent = fr.start.copy()
    bent[4] = -0.9  # the demo starts near a singularity of the wrist
    return Steering(bounds, fr.lower, fr.upper, 1.0, task), task, bent


def moved(arm, motion, ticks):
    steering, _, setpoint = arm
    last = np.zeros(len(setpoint))
    for _ in range(ticks):
        last = steering.step(motion, setpoint, last)
        setpoint = setpoint + last
    return setpoint, last


@pytest.mark.parametrize("row", range(6))
def test_the_tool_moves_along_one_row_and_stays_in_the_others(arm, row):
    _, task, start = arm
    motion = ToolTwist(0.2 * np.eye(6)[row])
    setpoint, _ = moved(arm, motion, 80)
    error = task.error(start, task.place(setpoint))
    assert error[row] > 0.01
    assert np.all(np.abs(np.delete(error, row)) < 0.1 * error[row])


def test_the_tool_keeps_its_speed_limit(arm):
    steering, task, _ = arm
    setpoint, last = moved(arm, ToolTwist(np.array([1.0, 0, 0, 0, 0, 0])), 60)
    speed = task.jacobian(setpoint - last)[:3] @ last / steering.bounds.period
    assert TOOL_SPEED * 0.9 < np.linalg.norm(speed) < TOOL_SPEED * 1.02


def test_the_tool_reaches_its_target_and_rests(arm):
    _, task, start = arm
    here = task.place(start)
    goal = Placement(here.R, here.t + np.array([-0.05, 0.08, -0.04]))
    setpoint, last = moved(arm, ToolTarget(goal), 400)
    assert np.linalg.norm(task.error(setpoint, goal)) < 1e-3
    assert np.all(np.abs(last) < 1e-5)


def test_no_joint_exceeds_its_speed_in_a_singularity(arm):
    steering, _, start = arm
    setpoint, last = start.copy(), np.zeros(len(start))
    setpoint[-2] = 1e-4  # the wrist stretched
    for _ in range(100):
        dq = steering.step(ToolTwist(np.array([0.3, 0.3, 0, 0, 1.0, 0])), setpoint, last)
        assert np.all(np.abs(dq) <= steering.bounds.increment + EPS)
        last, setpoint = dq, setpoint + dq
