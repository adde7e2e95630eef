"""Starts with a violated clearance, in penetration, beyond a limit: only motion deeper is a violation."""

from pathlib import Path

import numpy as np
import pytest

from armgate import events as e
from monitor.test_planted_faults import DOWN, TOGETHER
from monitor.watched import ARM, GANTRY, Watched, demo

UP = {ARM: np.radians([0, -94, 108, 0, -5.5, 0])}
NEAR_FLOOR = np.radians([0, 33.5, -33.5, 0, 90, 0])
"""The camera's housing is about 30 mm above the floor."""

IN_FLOOR = np.radians([0, 34.5, -31.0, 0, 90, 0])
BEYOND = np.radians([187, -94, 108, 0, -5.5, 0])


def started(folder: Path, start, **fault) -> Watched:
    watched = Watched(demo(ARM), folder, start={ARM: list(start)}, **fault)
    watched.rest(3)
    assert watched.findings == []
    return watched


@pytest.mark.parametrize("start", [NEAR_FLOOR, IN_FLOOR], ids=["near the floor", "in the floor"])
def test_a_retreat_raises_no_alarm(tmp_path, start):
    watched = started(tmp_path, start)
    assert watched.monitor.summary.retreats >= 1
    assert watched.toward(UP, 200) == []
    assert np.allclose(watched.runner.view(ARM).setpoint, UP[ARM], atol=0.2)
    assert watched.monitor._floors == {}  # after the retreat the pair has its normal limit again


@pytest.mark.parametrize("start", [NEAR_FLOOR, IN_FLOOR], ids=["near the floor", "in the floor"])
def test_motion_deeper_into_a_violation_is_found(tmp_path, start):
    """The floor of the gate's model is lower than the true one, so that the gate sees no violation."""
    watched = started(tmp_path, start, wrong=lambda t: t["surroundings"]["floor"].update(xyz=[1.5, 0, -0.5]))
    found = watched.toward({ARM: start + np.radians([0, 0, 3, 0, 0, 0])}, 60)
    assert {f.kind for f in found} == {"clearance"}
    # From inside the floor another body comes too near before the first one has gone much deeper.
    assert ("the retreat began" in found[0].text) == (start is NEAR_FLOOR)


def test_a_joint_that_starts_beyond_a_limit_may_only_move_back(tmp_path):
    watched = started(tmp_path, BEYOND)
    assert watched.toward(UP, 60) == []


def test_a_joint_that_moves_farther_beyond_its_limit_is_found(tmp_path):
    def wide(tree):
        file = Path(tree["robots"][ARM]["urdf"])
        (tmp_path / "wide.urdf").write_text(file.read_text().replace("3.2288591161895095", "6.0"))
        tree["robots"][ARM]["urdf"] = str(tmp_path / "wide.urdf")

    watched = started(tmp_path, BEYOND, wrong=wide)
    found = watched.toward({ARM: BEYOND + np.radians([2, 0, 0, 0, 0, 0])}, 60)
    assert [(f.kind, f.joint) for f in found] == [("limit", "A1")]


def test_a_pushed_robot_may_retreat_after_a_reset(tmp_path):
    """A push that violates a clearance is found once; after the reset the retreat raises no alarm."""
    watched = Watched(demo(ARM), tmp_path)
    watched.toward(DOWN, 130)
    watched.rest(60)
    assert watched.findings == []
    pushed = tuple(np.add(watched.runner.view(ARM).setpoint, [0.0, 0.02, 0.0, 0.0, 0.0, 0.0]))
    watched.noise = lambda _robot, _q: pushed
    watched.rest(60)
    assert {f.kind for f in watched.findings} == {"stray", "clearance"}
    told = watched.runner.feed(e.Reset(watched.runner.view(ARM).stops[0], "t"))
    assert told[0].accepted
    watched.links[ARM]._robot._q = pushed
    watched.noise = None
    watched.runner.feed(e.LeaseChange(ARM, 1))
    watched.findings.clear()
    watched.rest(5)
    assert watched.toward(UP, 120) == []
    assert watched.verdicts[-1].outcome != "refused"


@pytest.fixture
def too_near(tmp_path):
    """Return two robots that start 20 mm closer to each other than required, and their positions."""
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.toward(TOGETHER, 260)
    watched.rest(60)
    start = {name: watched.runner.view(name).setpoint for name in (ARM, GANTRY)}
    start[GANTRY] = (start[GANTRY][0] - 0.02, *start[GANTRY][1:])
    again = Watched(demo(ARM, GANTRY), tmp_path, start=start)
    again.rest(3)
    assert again.monitor.summary.retreats >= 1
    return again, start


@pytest.mark.slow
def test_two_robots_that_are_too_close_may_move_apart(too_near):
    """The gate admits one at a time."""
    watched, start = too_near
    away = {ARM: UP[ARM], GANTRY: [2.9, 0.0, 2.5, *start[GANTRY][3:]]}
    assert watched.toward(away, 150) == []
    assert watched.monitor._floors == {}


def test_a_violated_clearance_keeps_its_floor_while_states_are_missing(too_near):
    watched, _ = too_near
    floors = dict(watched.monitor._floors)
    gantry = watched.links.pop(GANTRY)
    watched.rest(6)
    assert watched.monitor._floors == floors != {}
    watched.links[GANTRY] = gantry
    gantry._tick = watched.tick
    watched.rest(3)
    assert watched.findings == []


def test_a_joint_that_moves_on_beyond_its_limit_after_a_reset_is_found_again(tmp_path):
    def wide(tree):
        file = Path(tree["robots"][ARM]["urdf"])
        (tmp_path / "wide.urdf").write_text(file.read_text().replace("3.2288591161895095", "6.0"))
        tree["robots"][ARM]["urdf"] = str(tmp_path / "wide.urdf")

    inside = np.radians([184.5, -94, 108, 0, -5.5, 0])
    watched = started(tmp_path, inside, wrong=wide)
    assert watched.toward({ARM: BEYOND}, 60)[0].kind == "limit"
    for _ in range(20):  # well beyond, before the stop acts
        watched.instant()
        watched.command(ARM, [0.01, 0, 0, 0, 0, 0])
    watched.rest(60)
    watched.findings.clear()
    assert watched.stop_and_reset()
    watched.runner.feed(e.LeaseChange(ARM, 1))
    assert watched.rest(20) == []
    assert watched.toward({ARM: inside}, 5, speed=0.05) == []  # a retreat is no finding
    assert watched.runner.view(ARM).setpoint[0] > np.radians(185.5)
    found = watched.toward({ARM: BEYOND + np.radians([20, 0, 0, 0, 0, 0])}, 60)
    assert [(f.kind, f.joint) for f in found] == [("limit", "A1")]
