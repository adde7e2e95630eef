"""Faults planted into the gate, its model, its links and its reports: the monitor must find each.

Every fault runs in a scenario in which it has an effect, and every scenario also runs without a fault.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from armgate import events as e
from armgate.gate import braking, decision
from armgate.monitor.motion import Motion
from armgate.monitor.tick_state import state_of_entry
from armgate.protocol import messages as m
from armgate.world import to_protocol
from monitor.watched import ARM, GANTRY, Change, Tree, Watched, demo

DOWN = {ARM: np.radians([0, 30, 60, 0, 0, 0])}
FOLD = {ARM: np.radians([0, -154, 150, 0, 100, 0])}
ROUND = {ARM: np.radians([200, -94, 108, 0, -5.5, 0])}
ONTO_PIPE = {GANTRY: [2.6, 0.5, 1.9, *np.radians([179, -90, 90, 0, -90, 0])]}
WRIST_UP = np.radians([0, 32, -32, 0, 0, 0])
WRIST_DOWN = {ARM: np.radians([0, 32, -32, 0, 100, 0])}
TOGETHER = {
    ARM: np.radians([0, -20, 20, 0, 0, 0]),
    GANTRY: [1.0, 0.0, 2.2, *np.radians([0, -90, 90, 0, -90, 0])],
}


@dataclass(frozen=True)
class Scenario:
    robots: tuple[str, ...]
    goals: dict
    ticks: int
    speed: float = 1.0
    start: dict | None = None


SCENARIOS = {
    "down": Scenario((ARM,), DOWN, 130),
    "fold": Scenario((ARM,), FOLD, 150),
    "wrist": Scenario((ARM,), WRIST_DOWN, 60, start={ARM: WRIST_UP.tolist()}),
    "round": Scenario((ARM,), ROUND, 150),
    "fast": Scenario((ARM,), ROUND, 60, 1.3),
    "onto the pipe": Scenario((GANTRY,), ONTO_PIPE, 220),
    "together": Scenario((ARM, GANTRY), TOGETHER, 260),
}


def driven(scenario: Scenario, folder: Path, **fault) -> Watched:
    watched = Watched(demo(*scenario.robots), folder, start=scenario.start, **fault)
    watched.toward(scenario.goals, scenario.ticks, scenario.speed)
    return watched


@pytest.mark.daily(2)
@pytest.mark.parametrize("name", SCENARIOS)
def test_no_scenario_raises_an_alarm_without_a_fault(name, tmp_path):
    watched = driven(SCENARIOS[name], tmp_path)
    assert watched.findings == []
    assert watched.monitor.summary.states == SCENARIOS[name].ticks * len(SCENARIOS[name].robots)
    # All scenarios but "fast" end with a limited or refused command.
    assert watched.verdicts[-1].outcome != "admitted" or name == "fast"


# --- the model --------------------------------------------------------------------------------------------


def arm(**changes) -> Change:
    return lambda tree: tree["robots"][ARM].update(changes)


def surrounding(name: str, **changes) -> Change:
    return lambda tree: tree["surroundings"][name].update(changes)


def urdf(robot: str, old: str, new: str) -> Change:
    """Return a change of the URDF that the gate reads."""

    def change(tree: Tree) -> None:
        file = Path(tree["robots"][robot]["urdf"])
        text = file.read_text()
        assert text.count(old) >= 1
        wrong = Path(tree["folder"]) / "wrong.urdf"
        wrong.write_text(text.replace(old, new))
        tree["robots"][robot]["urdf"] = str(wrong)

    return change


def drop_surrounding(name: str) -> Change:
    return lambda tree: tree["surroundings"].pop(name)


def housing(**changes) -> Change:
    return lambda tree: tree["robots"][ARM]["bodies"]["camera_housing"].update(changes)


def ignored(*pair: str) -> Change:
    return lambda tree: tree["robots"][ARM]["ignore_pairs"].append(list(pair))


def top(**changes) -> Change:
    return lambda tree: tree.update(changes)


def joint(name: str, **changes) -> Change:
    return lambda tree: tree["robots"][ARM].setdefault("joints", {}).update({name: changes})


A3_ORIGIN = '<origin xyz="0.68 0 0"/>'
A5 = '<axis xyz="0 1 0"/>\n    <limit lower="-2.2689280275926285" upper="2.2689280275926285"'
A1_LIMITS = 'lower="-3.2288591161895095" upper="3.2288591161895095"'
A1_SPEED = 'upper="3.2288591161895095" velocity="2.722713633111154"'
SHOULDER = '<capsule radius="0.14" length="0.16"/>'

MODEL_FAULTS: dict[str, tuple[str, Change]] = {
    "a pair is dropped": ("down", ignored("camera_housing", "floor")),
    "the stop distance is 1 mm less": ("down", top(stop_distance=0.049)),
    "the self distance is 2 mm less": ("fold", top(self_distance=0.018)),
    "a body is smaller": ("down", housing(shape={"box": [0.09, 0.09, 0.076]})),
    "a body has another placement": ("down", housing(xyz=[0, 0, 0.035])),
    "a body is missing": ("down", arm(bodies={})),
    "a body is turned": ("onto the pipe", surrounding("pipe_feed", rpy=["100 deg", 0, 0])),
    "the base is 2 mm too high": ("down", arm(base={"xyz": [0, 0, 0.002]})),
    "the base is tilted": ("down", arm(base={"rpy": [0, "-0.2 deg", 0]})),
    "the gantry hangs 5 mm too high": (
        "onto the pipe",
        lambda tree: tree["robots"][GANTRY]["gantry"]["mount"].update(xyz=[0, 0, 0.005]),
    ),
    "a link is 10 mm too short": ("wrist", urdf(ARM, A3_ORIGIN, '<origin xyz="0.67 0 0"/>')),
    "a joint turns the other way": ("wrist", urdf(ARM, A5, A5.replace("0 1 0", "0 -1 0"))),
    "a joint is missing from the kinematics": ("wrist", urdf(ARM, A5, A5.replace("0 1 0", "-1 0 0"))),
    "a limit is ignored": ("round", urdf(ARM, A1_LIMITS, 'lower="-6" upper="6"')),
    "a limit is 0.1 deg too wide": ("round", urdf(ARM, A1_LIMITS, 'lower="-3.2288" upper="3.23060"')),
    "a joint may be 20 % faster": ("fast", urdf(ARM, A1_SPEED, A1_SPEED.replace("2.7227", "3.2672"))),
    "an acceleration is doubled": ("down", joint("A2", acceleration="1248 deg/s2")),
    "a deceleration is 5 % too large": ("round", joint("A1", deceleration=11.435)),
    "a deceleration is unbounded": ("round", joint("A1", deceleration=None)),
    "a body of the surroundings is 5 mm too low": ("down", surrounding("floor", xyz=[1.5, 0, -0.105])),
    "a body of the surroundings is missing": ("onto the pipe", drop_surrounding("pipe_feed")),
    "a radius is 2 mm too small": ("fold", urdf(ARM, SHOULDER, '<capsule radius="0.138" length="0.16"/>')),
}  # fmt: skip


@pytest.mark.daily(6)
@pytest.mark.parametrize("name", MODEL_FAULTS)
def test_a_wrong_model_of_the_gate_is_found(name, tmp_path):
    scenario, change = MODEL_FAULTS[name]

    def wrong(tree: Tree) -> None:
        tree["folder"] = str(tmp_path)
        change(tree)
        del tree["folder"]

    assert driven(SCENARIOS[scenario], tmp_path, wrong=wrong).findings


def test_all_pairs_between_robots_dropped_is_found(tmp_path):
    def without(cell):
        return replace(cell, pairs=tuple(p for p in cell.pairs if p.kind != "robots"))

    findings = driven(SCENARIOS["together"], tmp_path, wrong_cell=without).findings
    assert findings[0].kind == "clearance"
    assert {name.partition("/")[0] for name in findings[0].pair} == {ARM, GANTRY}


# --- plans on their way to the link, and the gate's own arithmetic ----------------------------------------


def scaled(plan: e.Plan, factor: float) -> e.Plan:
    return replace(plan, increments=tuple(tuple(factor * x for x in u) for u in plan.increments))


def stretched(plan: e.Plan) -> e.Plan:
    """Return a plan that brakes half as fast."""
    first, *rest = plan.increments
    return replace(plan, increments=(first, *(u for u in rest for _ in range(2))))


PLAN_FAULTS: dict[str, Callable[[e.Plan], e.Plan]] = {
    "increments are doubled": lambda plan: scaled(plan, 2.0),
    "increments are 5 % larger": lambda plan: scaled(plan, 1.05),
    "the braking is missing": lambda plan: replace(plan, increments=plan.increments[:1]),
    "the braking takes twice as long": stretched,
}


@pytest.mark.parametrize("name", PLAN_FAULTS)
def test_a_link_that_plays_other_plans_is_found(name, tmp_path):
    assert driven(SCENARIOS["down"], tmp_path, tamper=PLAN_FAULTS[name]).findings


def test_a_stop_distance_computed_too_short_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(braking, "stop_share", lambda m: 0.0)
    monkeypatch.setattr(decision, "stop_increments", lambda u, decel: (tuple(u),) if any(u) else ())
    assert driven(SCENARIOS["down"], tmp_path).findings


# --- what states report -----------------------------------------------------------------------------------


def moved_by(values, offset):
    return (values[0] + offset, *values[1:])


WRONG_ENTRIES: dict[str, Callable[[m.Entry], m.Entry]] = {
    "the end of the stop is the setpoint": lambda s: s.model_copy(update={"stop_end": s.setpoint}),
    "the end of the stop is off": lambda s: s.model_copy(update={"stop_end": moved_by(s.stop_end, 0.01)}),
    "the measured position is off": lambda s: s.model_copy(update={"q": moved_by(s.q, s.tick * 1e-5)}),
    "distances are 1 mm too large": lambda s: s.model_copy(
        update={
            "nearest": tuple(n.model_copy(update={"distance": n.distance + 1e-3}) for n in s.nearest or ())
        }
    ),
    "a tick comes twice": lambda s: s.model_copy(update={"tick": max(s.tick - s.tick // 40, 0)}),
    "a joint is left out": lambda s: s.model_copy(update={"q": s.q[:-1]}),
}


@pytest.mark.parametrize("name", WRONG_ENTRIES)
def test_a_wrong_state_is_found(name, tmp_path):
    watched = Watched(demo(ARM), tmp_path)
    watched.falsify = WRONG_ENTRIES[name]
    assert watched.toward(DOWN, 130)


@pytest.mark.parametrize("robot", [ARM, GANTRY])
def test_wrong_distances_of_each_of_two_robots_are_found(tmp_path, robot):
    wrong = WRONG_ENTRIES["distances are 1 mm too large"]
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.falsify = lambda s: wrong(s) if s.robot == robot else s
    assert {(f.kind, f.robot) for f in watched.rest(60)} == {("distance", robot)}


def test_a_reset_that_moves_the_setpoint_is_found(tmp_path):
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(3)
    link = watched.links[ARM]
    rebase = link.rebase
    link.rebase = lambda order: rebase(replace(order, setpoint=moved_by(order.setpoint, 0.05)))
    assert watched.stop_and_reset()
    watched.rest(3)
    assert {f.kind for f in watched.findings} & {"speed", "acceleration"}


def test_a_robot_that_slips_is_found(tmp_path):
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(5)
    watched.noise = lambda _robot, q: moved_by(q, 1e-4)
    assert watched.rest(2)[0].kind == "stray"


def test_a_robot_without_further_states_is_found(tmp_path):
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.rest(3)
    del watched.links[GANTRY]
    found = watched.rest(100)
    assert [(f.kind, f.robot) for f in found] == [("silence", GANTRY)]


@pytest.mark.parametrize("link", ["lost", "faulted", "waiting"])
def test_a_robot_whose_link_has_ended_is_not_silent(tmp_path, link):
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.rest(3)
    arm = state_of_entry(
        to_protocol.entry(ARM, watched.runner.view(ARM), None).model_copy(update={"link": link})
    )
    for tick in range(3, 200):
        own = to_protocol.entry(GANTRY, watched.runner.view(GANTRY), None)
        own = own.model_copy(update={"tick": tick, "time": tick * 0.012})
        assert watched.monitor.check(state_of_entry(own), [arm]) == []
    assert watched.monitor.add_silence(2.0) != []  # of the other robot
    assert {f.robot for f in watched.monitor.summary.findings} == {GANTRY}


def test_pairs_of_a_robot_with_old_states_are_not_checked(tmp_path):
    """Its last position, from states of the other robot, does not count after 2.5 periods."""
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.rest(3)
    monitor, index = watched.monitor, [r.name for r in watched.monitor.cell.robots].index(ARM)
    own, arm = (state_of_entry(to_protocol.entry(r, watched.runner.view(r), None)) for r in (GANTRY, ARM))
    for ticks, seen in ((1, True), (2, True), (3, False), (4, False)):
        monitor.check(replace(own, tick=own.tick + ticks, time=own.time + ticks * 0.012), [arm])
        assert monitor._clearances.has_poses(index) == seen


def test_accelerations_are_not_checked_while_a_link_is_not_ready(tmp_path):
    """The gate limits only speeds then."""
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(3)
    monitor = watched.monitor
    sample = state_of_entry(to_protocol.entry(ARM, watched.runner.view(ARM), None))
    fast = 0.9 * monitor.cell.robots[0].velocity[0] * 0.012

    def kinds(step, ready):
        nonlocal sample
        q = sample.setpoint + np.eye(len(sample.q))[0] * step
        sample = replace(sample, tick=sample.tick + 1, time=sample.time + 0.012, setpoint=q, stop_end=q)
        sample = replace(sample, ready=ready)
        return {finding.kind for finding in monitor.check(sample)}

    for step, ready in ((0.0, False), (fast, False), (0.0, False), (0.0, True)):
        assert kinds(step, ready) == set()
    assert "acceleration" in kinds(fast, True)


@pytest.mark.parametrize(
    ("holds", "off", "expected"),
    [(True, 0.0, set()), (True, 1e-5, {"acceleration"}), (False, 0.0, {"acceleration"})],
)
def test_a_holding_link_may_undo_only_the_newest_increment(tmp_path, holds, off, expected):
    """The reply was late: the robot is held at the previous setpoint, and starts from rest."""
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(3)
    robot = replace(watched.monitor.cell.robots[0], holds=holds)
    motion, sample = Motion(robot), state_of_entry(to_protocol.entry(ARM, watched.runner.view(ARM), None))
    unit = np.eye(robot.n)[0] * robot.acceleration[0] * 0.012**2
    motion.check(sample)
    kinds = set()
    for step in (0.0, 0.9, 1.8, -1.8 + off / unit[0], 0.0, 0.9):
        q = sample.setpoint + step * unit
        sample = replace(sample, tick=sample.tick + 1, time=sample.time + 0.012, q=q, setpoint=q, stop_end=q)
        kinds |= {finding.kind for finding in motion.check(sample)[1]}
    assert kinds - {"stop_end"} == expected


def test_stray_positions_are_not_checked_after_missed_setpoints(tmp_path):
    """The robot may follow setpoints of the missed states until these can no longer act."""
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(5)
    (sample,) = (motion.last for motion in watched.monitor._motions)

    def kinds(ticks):
        nonlocal sample
        time = sample.time + ticks * 0.012
        sample = replace(sample, tick=sample.tick + ticks, time=time, q=sample.q + 1e-4)
        return {finding.kind for finding in watched.monitor.check(sample)}

    assert kinds(2) == kinds(1) == set()
    assert set.union(*(kinds(1) for _ in range(8))) == {"stray"}
