"""Former faults of the gate: the monitor finds them if the fixes are removed, and nothing with the fixes.

The gate could not detect its faults in resets under noise and in motion bounds beyond a limit, because it
relied on its own bounds.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armgate.gate.clearance import Clearance
from armgate.gate.gate import Gate
from armgate.gate.reservations import Reservations
from armgate.gate.robot import RobotState
from monitor.test_planted_faults import DOWN, ROUND
from monitor.watched import ARM, Tree, Watched, demo

NOISE = 1e-4


# --- resets at rest, under noise within the tolerance -----------------------------------------------------


@pytest.fixture
def _measured_becomes_setpoint(monkeypatch):
    """Reset to the measured position as setpoint, without updating the kept bounds."""
    monkeypatch.setattr(RobotState, "setpoint_after_reset", lambda self: self.measured)
    monkeypatch.setattr(Reservations, "prove_setpoint", lambda *_: True)


def reset_under_noise(folder: Path, goal, joint: int, ticks: int) -> Watched:
    """Drive to the required distance, rest, and reset repeatedly while the measured position is beyond it."""
    tree = demo(ARM)
    tree["robots"][ARM]["q_tolerance"] = NOISE
    watched = Watched(tree, folder)
    watched.toward(goal, ticks)
    watched.rest(60)
    watched.noise = lambda _robot, q: tuple(x + 0.9 * NOISE * (j == joint) for j, x in enumerate(q))
    for _ in range(18):
        watched.rest(8)
        assert watched.stop_and_reset()
    watched.rest(20)
    return watched


@pytest.mark.usefixtures("_measured_becomes_setpoint")
def test_setpoints_that_drift_closer_with_each_reset_are_found(tmp_path):
    watched = reset_under_noise(tmp_path, DOWN, joint=1, ticks=130)
    first = watched.findings[0]
    assert (first.kind, first.pair) == ("clearance", ("FR/camera_housing", "floor"))
    assert 0.0499 < first.value < 0.05 - 2e-5


@pytest.mark.usefixtures("_measured_becomes_setpoint")
def test_setpoints_that_drift_beyond_limits_with_each_reset_are_found(tmp_path):
    watched = reset_under_noise(tmp_path, ROUND, joint=0, ticks=150)
    assert [(f.kind, f.joint) for f in watched.findings[:1]] == [("limit", "A1")]


@pytest.mark.parametrize(("goal", "joint"), [(DOWN, 1), (ROUND, 0)])
def test_resets_under_noise_raise_no_alarm(tmp_path, goal, joint):
    assert reset_under_noise(tmp_path, goal, joint, 150).findings == []


# --- a start beyond the limit of a sliding joint behind a turning one -------------------------------------


URDF = """<robot name="slide">
  <link name="base"/>
  <link name="turn"/>
  <link name="slide">
    <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="tool0"/>
  <joint name="J0" type="revolute"><parent link="base"/><child link="turn"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="0"/></joint>
  <joint name="J1" type="prismatic"><parent link="turn"/><child link="slide"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" velocity="0.5" effort="0"/></joint>
  <joint name="flange" type="fixed"><parent link="slide"/><child link="tool0"/></joint>
</robot>
"""


def beyond_its_limit(folder: Path, distance: float) -> Watched:
    """Start a prismatic joint beyond its limit, and turn the robot toward a post."""
    (folder / "slide.urdf").write_text(URDF)
    tree: Tree = {
        "armgate": 1,
        "name": "slide",
        "stop_distance": 0.05,
        "robots": {"R": {"urdf": str(folder / "slide.urdf"), "start": [-1.2, 0.1]}},
        "surroundings": {"post": {"shape": {"cylinder": [0.03, 1.0]}, "xyz": [0.5 + distance, 0.0, 0.0]}},
    }
    watched = Watched(tree, folder, start={"R": [-1.2, 0.3 + distance]})
    watched.toward({"R": [1.0, 0.25 + distance]}, 150)
    return watched


@pytest.mark.parametrize("distance", [0.3, 0.6])
def test_motion_bounds_that_are_wrong_beyond_a_limit_are_found(tmp_path, monkeypatch, distance):
    monkeypatch.setattr(Clearance, "fit", lambda *_: None)
    findings = beyond_its_limit(tmp_path, distance).findings
    assert [(f.kind, f.pair) for f in findings[:1]] == [("clearance", ("R/slide", "post"))]


@pytest.mark.parametrize("distance", [0.3, 0.6])
def test_a_retreat_from_beyond_a_limit_raises_no_alarm(tmp_path, distance):
    watched = beyond_its_limit(tmp_path, distance)
    assert watched.findings == []
    assert any(verdict.outcome != "refused" for verdict in watched.verdicts)


# --- a link that plays other increments than the plan has -------------------------------------------------


def test_a_link_that_plays_other_increments_under_the_key_of_its_plan_is_found(tmp_path, monkeypatch):
    told = Gate._follow_plan

    def without_increment_check(self, *args):
        fault = told(self, *args)
        return None if fault is not None and "increment" in fault else fault

    monkeypatch.setattr(Gate, "_follow_plan", without_increment_check)

    def other(plan):
        return replace(plan, increments=tuple(tuple(16.0 * x for x in u) for u in plan.increments))

    watched = Watched(demo(ARM), tmp_path, tamper=other)
    watched.rest(3)
    for _ in range(20):
        watched.command(ARM, [0.0, 1e-4, 0.0, 0.0, 0.0, 0.0])
        if watched.instant():
            break
    assert watched.findings
    assert watched.tick <= 4, "at the first increment"
    assert watched.runner.view(ARM).stops == (), "the gate has raised no stop"
    assert np.max(np.abs(watched.cell.robot(ARM).velocity * 0.012)) > 16e-4  # slow enough for every bound
