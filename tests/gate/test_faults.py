"""Faults, resets and delays: positions that the robots can still reach must stay reserved."""

import numpy as np
import pytest

from armgate.events import (
    Command,
    LeaseChange,
    LinkChange,
    LinkState,
    PlanAnswer,
    Reset,
    ResetAnswer,
    Stop,
    Stopped,
    Tick,
    Verdict,
)
from armgate.gate import Gate
from gate import scenes
from gate.oracle import Oracle
from gate.rig import Rig


def toward(goal):
    def controller(rig, i):
        if i not in goal:
            return None
        robot = rig.cell.robots[i]
        v = np.array(goal[i]) - np.array(rig.players[i].setpoint)
        full = robot.velocity * robot.period
        return v / max(1.0, float(np.max(np.abs(v) / full)))

    return controller


def test_a_reset_before_a_delayed_robot_moves_keeps_its_path_reserved():
    """After a stop, with a short path already played, the delayed robot still stands but will move."""
    start = [np.array([-0.5, 0.0]), np.array([-0.3, 0.3])]
    rig = Rig(scenes.crossing(window=0.8), delay=(0.8, 0.0), stops=0.0, start=start)
    for _ in range(120):
        rig.step(toward({0: (0.4, 0.0)}))
    stop = rig.stop("fast")
    while rig.players[0].plan is not None:
        rig.step()
    far = rig.players[0].setpoint[0]
    assert far > -0.36
    assert rig.drives[0].q[0] == -0.5
    rig.reset(stop)  # a refusal while the lag window still contains motion would also be correct
    for _ in range(700):
        rig.step(toward({1: (far, 0.0)}))
    rig.check()
    assert rig.tally.violations == []


def test_a_reset_is_possible_once_a_delayed_robot_rests():
    rig = Rig(scenes.crossing(window=0.2), delay=(0.2, 0.0), stops=0.0)
    for _ in range(60):
        rig.step(toward({0: (0.4, 0.0)}))
    stop = rig.stop("fast")
    rig.rest()
    for _ in range(120):
        rig.step()
    answer, rebase = rig.reset(stop)
    assert answer.accepted
    assert rebase.setpoint == pytest.approx(rig.players[0].setpoint)


def off_by(rig, i, dq):
    """Move the robot to a position that no plan of it reaches."""
    rig.expect_faults = True
    rig.drives[i].q = rig.drives[i].q + np.array(dq)
    player = rig.players[i]
    return rig.feed(player.play(rig.now, [float(x) for x in rig.drives[i].q]))


def approach_after_fault(acknowledge_late: bool) -> float:
    """Measure the fast cart 0.1 m off its path; command the slow one to it. Return the least distance."""
    cell = scenes.crossing(window=0.0)
    gate = Gate(cell, "s")
    q = {"fast": (-0.5, 0.0), "slow": (0.0, 0.5)}
    for name, at in q.items():
        gate.step(Tick(name, 0, 0.0, at, at, (0.0, 0.0)))
        gate.step(LinkChange(name, LinkState.READY))
        gate.step(LeaseChange(name, 1))
    setpoint, plan = q["slow"], None
    nearest = np.inf
    for k in range(1, 1500):
        v = np.array((-0.4, 0.0)) - setpoint
        full = 0.4 * 0.004
        dq = tuple(map(float, v / max(1.0, np.max(np.abs(v)) / full)))
        verdict, *plans = gate.step(Command("slow", 1, k, k - 1, dq))
        assert isinstance(verdict, Verdict)
        if plans and not (k == 1 and acknowledge_late):
            gate.step(PlanAnswer("slow", plans[0].key, True))
        if k == 1:
            out = gate.step(Tick("fast", 1, 0.004, (-0.4, 0.0), q["fast"], (0.0, 0.0)))
            assert [o.robots for o in out if isinstance(o, Stopped)] == [("fast",)]
            if acknowledge_late:
                gate.step(PlanAnswer("slow", plans[0].key, True))
        if plans:
            plan, index = plans[0], 0
        elif plan is not None:
            index += 1
        if plan is not None and index >= len(plan.increments):
            plan = None
        u = plan.increments[index] if plan else (0.0, 0.0)
        before, setpoint = setpoint, tuple(a + b for a, b in zip(setpoint, u, strict=True))
        gate.step(
            Tick("slow", k, 0.004 * k, before, setpoint, u, plan.key if plan else None, index if plan else -1)
        )
        nearest = min(nearest, float(np.linalg.norm(np.array(setpoint) - (-0.4, 0.0))) - 0.1)
    return nearest


@pytest.mark.slow
def test_a_plan_answer_after_a_fault_does_not_restore_bounds_proven_before_it():
    late = approach_after_fault(True)
    assert late == pytest.approx(approach_after_fault(False), abs=1e-3)
    assert late > 0.1


def test_a_robot_off_its_path_is_stopped_alone_if_no_robot_is_near():
    rig = Rig(scenes.crossing(window=0.0), stops=0.0)
    out = off_by(rig, 0, (0.0, 0.05))
    (stopped,) = [o for o in out if isinstance(o, Stopped)]
    assert stopped.robots == ("fast",)
    assert stopped.by == "gate"
    assert rig.gate.view("slow").stops == ()


def test_a_robot_off_its_path_stops_the_robots_that_it_may_meet():
    rig = Rig(scenes.crossing(window=0.0), stops=0.0)
    out = off_by(rig, 0, (0.4, 0.4))
    first, second = [o for o in out if isinstance(o, Stopped)]
    assert (first.robots, second.robots) == (("fast",), ("slow",))
    assert second.reason == "its stop path may meet fast, which faulted"


def test_after_a_fault_and_its_reset_the_robot_continues_from_its_position():
    rig = Rig(scenes.crossing(window=0.0), stops=0.0)
    (stopped,) = [o for o in off_by(rig, 0, (0.0, 0.05)) if isinstance(o, Stopped)]
    rig.feed(rig.players[0].play(rig.now, [float(x) for x in rig.drives[0].q]))
    answer, rebase = rig.reset(stopped.id)
    assert isinstance(answer, ResetAnswer)
    assert answer.accepted
    assert rebase.setpoint == tuple(rig.drives[0].q)
    assert rig.command(0, (0.0005, 0.0)).outcome == "admitted"


@pytest.mark.daily(1)
@pytest.mark.parametrize("late", [0.0, 0.02, 0.1])
def test_a_delayed_robot_out_and_back_keeps_the_turning_point_reserved(late):
    """The setpoint returns before the robot has reached the turning point, which must stay reserved."""
    rig = Rig(scenes.crossing(window=0.12), delay=(0.12, 0.0), stops=0.05)

    def controller(rig, i):
        out = int(rig.now / 0.35 + late) % 2 == 0
        goal = {0: (0.3, 0.0) if out else (-0.5, 0.0), 1: (0.1, -0.5)}
        return toward(goal)(rig, i)

    rig.run(controller, 500)
    assert rig.tally.violations == []
    assert rig.tally.accepted > 0.3


def test_an_undeclared_delay_is_detected():
    """Without the declaration the same robot is soon found off its stop path and stopped."""
    rig = Rig(scenes.crossing(window=0.0), delay=(0.12, 0.0), stops=0.0)
    rig.expect_faults = True

    def controller(rig, i):
        return (0.012, 0.0) if i == 0 and int(rig.now / 0.1) % 2 == 0 else (-0.012, 0.004 * (i == 0))

    for _ in range(400):
        rig.step(controller)
    assert any(s.robots == ("fast",) and "off its stop path" in s.reason for s in rig.stopped)


def test_a_tree_robot_keeps_its_own_arms_apart():
    cell = scenes.tree()
    rig = Rig(cell, oracle=Oracle(cell), stops=0.05)
    goal = np.array([0.0, -1.0, -1.5, 1.0, 1.5])
    rig.run(toward({0: goal}), 400)
    assert rig.tally.violations == []
    assert rig.tally.least < 0.01  # the arms came near each other


@pytest.mark.parametrize("seed", range(4))
def test_motion_bounds_cover_a_start_with_a_slide_outside_its_limits(seed):
    """The bounds for positions inside the limits do not hold far outside, where the arm is longer."""
    robot = {
        "urdf": scenes.slide(),
        "base": {"xyz": [0, 0, 0.5]},
        "start": [0.0, 2.0, 0.0],
        "q_tolerance": 0.0,
    }
    wall = {"wall": {"shape": {"sphere": 0.1}, "xyz": [2.5 * np.cos(0.6), 2.5 * np.sin(0.6), 0.5]}}
    rig = Rig(scenes.build({"A": robot}, surroundings=wall), seed, stops=0.1)

    def controller(rig, i):
        return (0.024, -1e-5, 0.0)

    rig.run(controller, 150)
    assert rig.tally.violations == []


def plan_for(gate, name, k, dq):
    verdict, *plans = gate.step(Command(name, 1, k, k, dq))
    assert isinstance(verdict, Verdict)
    return plans[0]


def one_cart(q=(0.0, 0.5)):
    gate = Gate(scenes.crossing(window=0.0), "s")
    for name, at, setpoint in (("fast", (-0.5, 0.0), (-0.5, 0.0)), ("slow", q, (0.0, 0.5))):
        gate.step(Tick(name, 0, 0.0, at, setpoint, (0.0, 0.0)))
        gate.step(LinkChange(name, LinkState.READY))
        gate.step(LeaseChange(name, 1))
    return gate


@pytest.mark.parametrize("answer_first", [False, True])
def test_a_late_plan_is_counted_once_whether_the_tick_or_the_answer_comes_first(answer_first):
    gate = one_cart()
    for k in range(2):
        plan = plan_for(gate, "slow", k, (0.0001, 0.0))
        assert plan.key.last_played == -1
        unplayed = Tick("slow", k + 1, 0.004 * (k + 1), (0.0, 0.5), (0.0, 0.5), (0.0, 0.0))
        answer = PlanAnswer("slow", plan.key, False, "late")
        for event in (answer, unplayed) if answer_first else (unplayed, answer):
            gate.step(event)
        assert gate.view("slow").late == k + 1


def test_a_rebase_that_is_still_under_way_keeps_the_old_setpoint_reserved():
    """The robot moves on to its old setpoint a little until the link has received the new one."""
    setpoint, q = (0.0, 0.5), (9e-6, 0.5)
    gate = one_cart(q)
    (stopped,) = gate.step(Stop(("slow",), "why", "x"))
    for k in range(1, 4):
        gate.step(Tick("slow", k, 0.004 * k, q, setpoint, (0.0, 0.0)))
    assert gate.view("slow").stops == (stopped.id,)
    answer, rebase = gate.step(Reset(stopped.id, "x"))
    assert (answer.accepted, rebase.setpoint) == (True, q)
    assert gate.step(Tick("slow", 9, 0.036, (2e-6, 0.5), q, (0.0, 0.0))) == []
    assert gate.view("slow").stops == ()
    for k in range(10, 12):
        gate.step(Tick("slow", k, 0.004 * k, q, q, (0.0, 0.0)))
    assert gate.step(Tick("slow", 12, 0.05, (0.0, 0.5), q, (0.0, 0.0))) != []  # but no longer than that
