"""Recordings in which a link changes between two ticks: the daemon records the newest tick again.

Plans, stops and setpoints can differ in the second record of a tick. The monitor must accept the differences
that commands, stops and resets make, and must find all others.
"""

from pathlib import Path

import numpy as np
import pytest

from armgate import events as e
from armgate.daemon.recording.recorder import Recorder
from armgate.events import LinkState
from armgate.monitor.findings import Summary
from armgate.monitor.offline import check_recording
from monitor.test_planted_faults import DOWN, MODEL_FAULTS, SCENARIOS, TOGETHER, WRONG_ENTRIES, moved_by
from monitor.watched import ARM, GANTRY, Watched, demo

ENDED = [LinkState.FAULTED, LinkState.LOST]


def recorded(folder: Path, *robots: str, **fault) -> Watched:
    return Watched(demo(*robots), folder, recorder=Recorder(folder / "run", limit=1 << 30), **fault)


def checked(watched: Watched, *configs: Path) -> Summary:
    """Close the recording and check it."""
    watched.recorder.close()
    return check_recording(watched.recorder.folder, configs, 1.0)[1]


@pytest.mark.daily(2)
@pytest.mark.parametrize("state", ENDED)
@pytest.mark.parametrize("name", [ARM, GANTRY])
def test_a_link_that_ends_while_robots_move_is_no_violation(tmp_path, name, state):
    watched = recorded(tmp_path, ARM, GANTRY)
    watched.toward(TOGETHER, 15)  # its last commands have changed the plans since the last tick
    ends = [entry.stop_end for entry in watched.shown.entries]
    watched.change_link(name, state)
    assert all(entry.stop_end != end for entry, end in zip(watched.shown.entries, ends, strict=True))
    watched.toward(TOGETHER, 15)
    summary = checked(watched)
    assert summary.findings == []
    assert summary.states == 2 * 30


def test_a_link_that_is_ready_again_between_two_ticks_is_no_violation(tmp_path):
    watched = recorded(tmp_path, ARM)
    watched.toward(DOWN, 20)
    for state in (LinkState.LOST, LinkState.WAITING, LinkState.READY):
        watched.change_link(ARM, state)
    watched.rest(40)
    assert checked(watched).findings == []


def pushed_and_reset(folder: Path) -> Watched:
    """Push the arm while its link has faulted, and reset its stops at the position where it stands."""
    watched = recorded(folder, ARM, GANTRY)
    watched.rest(3)
    watched.change_link(ARM, LinkState.FAULTED)
    pushed = moved_by(watched.runner.view(ARM).q, 0.01)
    watched.noise = lambda robot, q: pushed if robot == ARM else q
    watched.rest(60)
    for stop in watched.runner.view(ARM).stops:
        watched.runner.feed(e.Reset(stop, "operator"))
    assert watched.runner.view(ARM).stops == ()
    assert watched.runner.view(ARM).setpoint == pushed
    return watched


@pytest.mark.parametrize(("name", "state"), [(ARM, LinkState.READY), (GANTRY, LinkState.LOST)])
def test_a_setpoint_that_a_reset_moves_between_two_ticks_is_no_violation(tmp_path, name, state):
    watched = pushed_and_reset(tmp_path)
    before = watched.shown.entries
    watched.change_link(name, state)
    assert watched.shown.entries[0].setpoint != before[0].setpoint
    watched.rest(3)
    assert checked(watched).findings == []


def test_a_reset_that_moves_the_setpoint_elsewhere_between_two_ticks_is_found(tmp_path):
    watched = pushed_and_reset(tmp_path)
    watched.falsify = lambda s: changed(setpoint=lambda q: moved_by(q, 0.05))(s) if s.robot == ARM else s
    watched.change_link(GANTRY, LinkState.LOST)
    assert [(f.kind, f.robot) for f in checked(watched).findings][:1] == [("speed", ARM)]


# --- violations at a fault ----------------------------------------------------------------------------------


def changed(**changes):
    return lambda entry: entry.model_copy(
        update={key: change(getattr(entry, key)) for key, change in changes.items()}
    )


WRONG_ENTRIES_AT_A_FAULT = {
    "the end of the stop is the setpoint": (WRONG_ENTRIES["the end of the stop is the setpoint"], "stop_end"),
    "the end of the stop is off": (changed(stop_end=lambda end: moved_by(end, 0.05)), "stop_end"),
    "the stop ends beyond a limit": (changed(stop_end=lambda end: moved_by(end, 7.0)), "limit"),
    "the stop ends in the floor": (changed(stop_end=lambda _: DOWN[ARM].tolist()), "clearance"),
    "the setpoint has moved": (changed(setpoint=lambda q: moved_by(q, 1e-4)), "speed"),
    "the setpoint is the measured position": (lambda s: s.model_copy(update={"setpoint": s.q}), "speed"),
    "another position was measured": (changed(q=lambda q: moved_by(q, 1e-6)), "form"),
    "it comes at another time": (changed(time=lambda time: time + 1e-3), "form"),
    "a joint is left out": (changed(setpoint=lambda q: q[:-1]), "form"),
}  # fmt: skip


@pytest.mark.daily(3)
@pytest.mark.parametrize("state", ENDED)
@pytest.mark.parametrize("name", WRONG_ENTRIES_AT_A_FAULT)
def test_a_wrong_second_state_of_a_tick_is_found(tmp_path, name, state):
    watched = recorded(tmp_path, ARM)
    assert watched.toward(DOWN, 30) == []
    watched.falsify, kind = WRONG_ENTRIES_AT_A_FAULT[name]
    watched.change_link(ARM, state)
    assert kind in {finding.kind for finding in checked(watched).findings}


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    "name",
    [
        "the stop distance is 1 mm less",
        "a body has another placement",
        "a body is smaller",
        "a limit is ignored",
        "a radius is 2 mm too small",
        "a limit is 0.1 deg too wide",
    ],
)
def test_a_plan_of_a_wrong_gate_is_found_although_its_link_faults_before_the_next_tick(tmp_path, name):
    scenario, wrong = MODEL_FAULTS[name]
    goals = SCENARIOS[scenario].goals

    def driven(ticks: int, folder: str) -> Watched:
        (tmp_path / folder).mkdir()

        def change(tree):
            tree["folder"] = str(tmp_path / folder)
            wrong(tree)
            del tree["folder"]

        watched = recorded(tmp_path / folder, ARM, wrong=change)
        watched.toward(goals, ticks)
        return watched

    first = driven(SCENARIOS[scenario].ticks, "first").findings[0].tick
    watched = driven(first, "run")
    assert watched.findings == []
    watched.change_link(ARM, LinkState.FAULTED)
    found = checked(watched, tmp_path / "run" / "true.yaml").findings
    assert (ARM, first - 1) in {(finding.robot, finding.tick) for finding in found}


def test_a_setpoint_that_jumps_at_the_tick_after_a_fault_is_found(tmp_path):
    watched = recorded(tmp_path, ARM)
    watched.toward(DOWN, 20)
    watched.change_link(ARM, LinkState.FAULTED)
    watched.falsify = changed(setpoint=lambda q: moved_by(q, 0.1))
    watched.rest(1)
    assert "speed" in {finding.kind for finding in checked(watched).findings}


def test_a_violation_that_lasts_is_reported_once_although_its_tick_is_recorded_again(tmp_path):
    watched = recorded(tmp_path, ARM, GANTRY)
    watched.rest(3)
    watched.falsify = lambda s: (
        s.model_copy(update={"q": moved_by(s.q, s.tick * 1e-3)}) if s.robot == ARM else s
    )
    watched.rest(3)
    watched.change_link(GANTRY, LinkState.LOST)
    watched.rest(3)
    assert [finding.kind for finding in checked(watched).findings].count("stray") == 1


def test_a_collision_with_another_robot_in_a_second_state_is_found(tmp_path):
    watched = recorded(tmp_path, ARM, GANTRY)
    watched.toward(TOGETHER, 120)
    near = np.array(watched.runner.view(GANTRY).setpoint)
    watched.falsify = changed(stop_end=lambda end: TOGETHER[ARM].tolist() if len(end) < len(near) else end)
    watched.change_link(ARM, LinkState.FAULTED)
    pairs = [finding.pair for finding in checked(watched).findings if finding.kind == "clearance"]
    assert {name.partition("/")[0] for pair in pairs for name in pair} == {ARM, GANTRY}


def test_stop_ends_of_two_robots_from_different_moments_are_not_compared(tmp_path):
    """The gantry has given up its plan before the arm gets a plan to the same place."""
    watched = recorded(tmp_path, ARM, GANTRY)
    watched.rest(3)
    start = np.array(watched.runner.view(GANTRY).setpoint)
    ends = {ARM: TOGETHER[ARM], GANTRY: start + 0.3 * (TOGETHER[GANTRY] - start)}

    def stopping(*robots):
        return lambda s: s.model_copy(update={"stop_end": tuple(ends[s.robot])}) if s.robot in robots else s

    watched.falsify = stopping(GANTRY)
    watched.rest(1)
    watched.falsify = stopping(ARM)
    watched.change_link(ARM, LinkState.FAULTED)
    watched.falsify = stopping(ARM, GANTRY)
    watched.rest(1)
    clearances = [finding for finding in checked(watched).findings if finding.kind == "clearance"]
    assert {finding.tick for finding in clearances} == {4}, "at the tick at which both have these plans"
