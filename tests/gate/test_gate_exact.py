"""The gate to the letter: ages, reservations, faults, counts and warnings, spoken to by hand."""

import numpy as np
import pytest

from armgate.events import (
    Cause,
    Command,
    LeaseChange,
    LinkChange,
    LinkState,
    Outcome,
    Plan,
    PlanAnswer,
    Rebase,
    Reset,
    ResetAnswer,
    Stop,
    Stopped,
    Tick,
)
from armgate.gate import Gate
from gate import scenes
from gate.scripted_gate import STEP, ScriptedGate, T, pair


def test_a_command_may_be_as_old_as_the_configuration_says_and_not_older():
    hands = pair()
    hands.rest(0, count=5)
    oldest = hands.cell.config.max_age_ticks
    assert hands.ask((0.0,), based_on=5 - oldest - 1).reasons[0].cause is Cause.STALE
    assert hands.ask((0.0,), based_on=5 - oldest).outcome is Outcome.ADMITTED
    hands.rest()
    assert hands.ask((0.0,)).outcome is Outcome.ADMITTED


def test_a_slot_is_free_again_at_its_tick():
    hands = pair()
    assert hands.ask((0.0,)).target == 1
    assert hands.ask((0.0,)).reasons[0].cause is Cause.OCCUPIED
    hands.rest()
    assert hands.ask((0.0,)).target == 2


def test_a_way_away_is_believed_only_once_the_link_has_it():
    """Before the answer the pair is as near as on the old way; after it as far as on the new one."""
    hands = pair()
    before = hands.kept()
    plan = hands.ask((-STEP,), answer=None)
    assert plan.outcome is Outcome.ADMITTED
    assert hands.kept() == hands.kept(1) <= before
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    assert before - 1.01 * STEP <= hands.kept() == hands.kept(1) <= before  # it still stands where it stood
    hands.play()
    hands.rest(0, count=2)
    hands.ask((0.0,), i=1)
    assert hands.view().setpoint == (hands.q[0][0],)


def test_a_way_toward_counts_from_the_verdict_on_and_until_it_is_refused_by_the_link():
    hands = pair()
    before = hands.kept()
    assert hands.ask((STEP,), answer=None).outcome is Outcome.ADMITTED
    assert hands.kept() == pytest.approx(before - STEP, abs=1e-8)
    assert hands.kept(1) == hands.kept()
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    assert hands.kept() == pytest.approx(before - STEP, abs=1e-8)


def test_two_ways_toward_each_other_count_together_whoever_is_answered_first():
    for order in ((0, 1), (1, 0)):
        hands = pair()
        before = hands.kept()
        hands.ask((STEP,), 0, answer=None)
        hands.ask((-STEP,), 1, answer=None)
        for i in order:
            hands.gate.step(PlanAnswer(hands.names[i], hands.held[i].key, True))
        assert hands.kept(0) == hands.kept(1) <= before - 2 * STEP + 1e-9
        assert hands.kept() >= before - 2 * STEP - 1e-8


def test_a_plan_dropped_is_free_for_the_other_again():
    """Room for one: the first is refused by its link, and after a look the second may go."""
    hands = pair(0.02 + 1.5 * STEP)
    assert hands.ask((STEP,), 0, answer=None).outcome is Outcome.ADMITTED
    assert hands.ask((-STEP,), 1).outcome is Outcome.REFUSED
    hands.gate.step(PlanAnswer("left", hands.held[0].key, False, "late"))
    hands.rest(0)
    hands.rest(1)
    assert hands.view().late == 1
    assert hands.ask((-STEP,), 1).outcome is Outcome.ADMITTED


def test_of_three_each_keeps_away_from_both_others():
    robots = {
        name: {"urdf": scenes.cart((1, 0, 0)), "start": [x], "period": p, "q_tolerance": 0.0}
        for name, x, p in (("a", -0.4, 0.004), ("b", 0.0, 0.012), ("c", 0.4, 0.008))
    }
    from gate.rig import Rig

    rig = Rig(scenes.build(robots), stops=0.02)
    for k in range(500):
        rig.step(lambda rig, i, k=k: (rig.cell.robots[i].period * (1.0, np.sin(k / 20), -1.0)[i],))
    rig.rest()
    rig.check()
    gaps = np.diff([float(d.q[0]) for d in rig.drives]) - 0.1
    assert rig.tally.violations == []
    assert np.all(gaps >= 0.02)
    assert np.all(gaps <= 0.04)


def test_applied_is_what_was_played_and_not_what_was_judged():
    hands = pair()
    verdict = hands.ask((STEP,))
    assert verdict.setpoint == (hands.q[0][0] + STEP,)
    assert hands.view().applied_seq is None
    hands.play()
    assert hands.view().applied_seq == 1
    assert (hands.view().tick, hands.view().time) == (1, T)
    hands.ask((0.0,), answer=None)
    hands.rest()
    assert hands.view().applied_seq == 1
    assert hands.view().late == 1


def test_verdicts_are_counted_by_outcome_and_last_cause():
    hands = pair()
    hands.ask((0.0,))
    hands.rest()
    hands.ask((1.0,))
    hands.ask((0.0,))
    hands.ask((0.0,))
    assert hands.view().counts == {"admitted": 1, "limited:acceleration": 1, "refused:occupied": 2}


def test_a_plan_out_of_order_is_a_fault():
    hands = pair()
    hands.ask((STEP,))
    plan = hands.held[0]
    wrong = Tick("left", 1, T, hands.q[0], (hands.q[0][0] + STEP,), (STEP,), plan.key, 1)
    (stopped,) = hands.gate.step(wrong)
    assert (stopped.robots, stopped.by) == (("left",), "gate")
    assert "has not given it" in stopped.reason


def test_after_a_plan_out_of_order_the_rest_of_the_held_plan_stays_reserved():
    hands = pair()
    for k in range(1, 5):
        hands.ask((k * 6e-5,))
        hands.play()
    plan, before = hands.held[0], hands.q[0][0]
    assert len(plan.increments) > 2
    (u,) = plan.increments[1]
    number = hands.tick[0] + 1
    hands.gate.step(Tick("left", number, number * T, (before,), (before + u,), (u,), plan.key, 7))
    assert hands.gate._robots[0].played == 0
    assert hands.view().stop_end[0] > before + u


def test_a_fault_at_the_first_tick_widens_nothing():
    cell = scenes.head_on(1.0, (T, T))
    gate = Gate(cell, "s")
    stopped = gate.step(Tick("left", 0, 0.0, (-0.5,), (-0.5,), (STEP,)))[0]
    assert stopped.robots == ("left",)
    assert gate._robots[0].main.occupied.tube == (0.0,)


def test_a_setpoint_that_a_link_begins_anew_with_is_proven_anew():
    """A link that is not ready may do so. The robot is then taken to move to that setpoint."""
    hands = pair()
    before, (x,) = hands.kept(), hands.q[0]
    hands.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    assert hands.gate.step(Tick("left", 1, T, (x,), (x + 0.05,), (0.0,), rebased=True)) == []
    assert hands.kept() == hands.kept(1) == pytest.approx(before - 0.05, abs=1e-8)


def test_a_robot_whose_tick_is_unreadable_is_not_known_to_rest_until_its_next_tick():
    hands = pair()
    (stop,) = hands.gate.step(Tick("left", 1, T, (float("nan"),), hands.q[0], (0.0,)))
    assert hands.gate.step(Tick("left", 1, T, (float("nan"),), hands.q[0], (0.0,))) == []
    assert hands.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    hands.rest(0)
    assert hands.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


def test_a_plan_of_nobody_is_a_fault():
    hands = pair()
    other = pair()
    other.ask((STEP,))
    (stopped,) = hands.gate.step(
        Tick("left", 1, T, hands.q[0], (hands.q[0][0] + STEP,), (STEP,), other.held[0].key, 0)
    )
    assert "has not given it" in stopped.reason


@pytest.mark.parametrize(
    ("off", "fault"), [(0.5e-9, False), (1e-9, False), (1.001e-9, True), (2e-9, True), (-2e-9, True)]
)
def test_a_setpoint_that_does_not_add_up_is_a_fault(off, fault):
    hands = ScriptedGate(scenes.head_on(1.0, (T, T)), [(0.0,), (0.6,)])
    out = hands.gate.step(Tick("left", 1, T, hands.q[0], (hands.q[0][0] + off,), (0.0,)))
    assert (out != []) == fault


def test_what_strayed_is_added_up_and_told():
    hands = pair(1.0)
    x = hands.q[0][0]
    (stopped,) = hands.rest(0, (x + 0.03,))
    assert "0.03 rad or m off its stop path" in stopped.reason
    state = hands.gate._robots[0]
    assert state.off_path == pytest.approx(0.03)
    assert hands.rest(0, (x + 0.1,)) == []  # once stopped it is not stopped again
    assert state.off_path == pytest.approx(0.03 + 0.07)
    assert all(e >= 0.03 for e in state.main.occupied.tube)


def test_a_fault_stops_whom_it_may_meet_only_if_not_stopped_already():
    hands = pair(0.1)
    first = hands.gate.step(Stop(("right",), "x", "y"))[0].id
    out = hands.rest(0, (hands.q[0][0] + 0.09,))
    assert [o.robots for o in out] == [("left",)]
    assert hands.view(1).stops == (first,)


def test_a_fault_far_from_others_stops_nobody_else():
    hands = pair(1.0)
    out = hands.rest(0, (hands.q[0][0] + 0.09,))
    assert [o.robots for o in out] == [("left",)]


def test_stops_are_numbered_and_a_reset_frees_all_that_it_stopped():
    hands = pair()
    (one,) = hands.gate.step(Stop(("left", "right"), "x", "y"))
    (two,) = hands.gate.step(Stop(("right",), "x", "y"))
    assert (one.id, two.id) == (1, 2)
    assert isinstance(one, Stopped)
    hands.rest(0)
    hands.rest(1)
    out = hands.gate.step(Reset(one.id, "x"))
    assert out[0] == ResetAnswer(one.id, True)
    assert [o.robot for o in out[1:] if isinstance(o, Rebase)] == ["left"]
    assert (hands.view(0).stops, hands.view(1).stops) == ((), (2,))


def test_a_reset_waits_for_all_that_it_frees():
    hands = pair()
    hands.ask((STEP,), 1)
    (stop,) = hands.gate.step(Stop(("left", "right"), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    hands.play(1)
    hands.rest(1, count=3)
    assert hands.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


def test_a_robot_whose_link_was_lost_is_not_known_to_rest_until_it_speaks():
    hands = pair()
    (stop,) = hands.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    assert hands.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    hands.rest(0)
    assert hands.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)
    assert hands.gate.step(LinkChange("right", LinkState.WAITING)) == []


def test_who_has_not_spoken_keeps_all_others_waiting():
    cell = scenes.head_on(1.0, (T, T))
    gate = Gate(cell, "s")
    gate.step(Tick("left", 0, 0.0, (-0.5,), (-0.5,), (0.0,)))
    gate.step(LinkChange("left", LinkState.READY))
    gate.step(LeaseChange("left", 1))
    (verdict,) = gate.step(Command("left", 1, 1, 0, (STEP,)))
    assert verdict.reasons[0].cause is Cause.LINK
    assert "right" in verdict.reasons[0].text
    assert gate.view("right").q == ()
    gate.step(Tick("right", 0, 0.0, (0.5,), (0.5,), (0.0,)))
    verdict, plan = gate.step(Command("left", 1, 2, 0, (STEP,)))
    assert verdict.outcome is Outcome.ADMITTED
    assert isinstance(plan, Plan)


@pytest.mark.parametrize(("gaps", "asked", "told"), [(0, 0, 0), (1, 1000, 0), (1, 999, 1), (3, 2999, 1)])
def test_more_than_one_gap_in_a_thousand_is_told(gaps, asked, told):
    hands = pair()
    certifier = hands.gate._clearance.certifier
    certifier.gaps, certifier.queries = gaps, asked
    assert len(hands.gate.warnings()) == told
    assert all(f"{gaps} of {asked}" in text for text in hands.gate.warnings())


def test_the_least_clearance_is_the_least_of_all_ticks_to_others():
    hands = pair(0.1)
    hands.rest()
    first = hands.view().least_clearance
    assert first == pytest.approx(0.1, abs=1e-6)
    hands.ask((STEP,))
    hands.play()
    hands.rest()
    least = hands.view().least_clearance
    assert least == pytest.approx(0.1 - STEP, abs=1e-6)
    hands.ask((-STEP,))
    hands.play()
    hands.rest()
    assert hands.view().least_clearance == least


def test_a_delayed_robot_keeps_its_window_of_setpoints():
    """Each old setpoint counts until the window has passed since it was left."""
    cell = scenes.crossing(window=0.036, periods=(0.012, 0.004))
    hands = ScriptedGate(cell)
    hands.ask((5e-4, 0.0))
    hands.play()
    start = (-0.5, 0.0)
    seen = []
    for _ in range(5):
        hands.rest(0, start)
        seen.append(start in [q for _, q in hands.gate._robots[0].history])
    assert seen == [True, True, True, False, False] or seen == [True, True, False, False, False]
    state = hands.gate._robots[0]
    assert max(until for until, _ in state.history) == pytest.approx(state.time)


def test_before_its_first_tick_a_robot_has_no_place_and_after_it_its_nearest_pairs():
    gate = Gate(scenes.lane(), "s")
    view = gate.view("A")
    assert (view.tick, view.time, view.q, view.setpoint, view.stop_end) == (0, 0.0, (), (), ())
    assert (view.nearest, view.least_clearance) == ((), None)
    gate.step(Tick("A", 0, 0.0, (-1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)))
    (near,) = gate.view("A").nearest
    assert near.distance == pytest.approx(1.45, abs=1e-6)
    assert gate.view("A").least_clearance == near.distance


def test_the_state_tells_the_three_nearest_pairs():
    around = {f"ball_{k}": {"shape": {"sphere": 0.1}, "xyz": [0.5 + 0.1 * k, 0, 0]} for k in range(5)}
    robot = {"urdf": scenes.cart((1, 0, 0)), "start": [-0.5]}
    hands = ScriptedGate(scenes.build({"A": robot}, surroundings=around))
    assert [n.pair[1] for n in hands.view().nearest] == ["ball_0", "ball_1", "ball_2"]


def test_the_least_clearance_is_one_to_others_and_was_asked_of_the_engine():
    """Its own arms are nearer to each other than anything else; bounds that nobody asked for are loose."""
    hands = ScriptedGate(scenes.tree(), [(1.5, -0.3, 0.0, 0.3, 0.0)])
    view = hands.view()
    own = [n for n in view.nearest if {x.split("/")[0] for x in n.pair} == {"A"}]
    others = [n for n in view.nearest if n not in own]
    assert min(n.distance for n in own) < min(n.distance for n in others)
    assert view.least_clearance == min(n.distance for n in others if n.points is not None)


@pytest.mark.parametrize("way", ["first", "rebased", "reset"])
def test_a_plan_after_none_replaces_none(way):
    hands = pair()
    if way != "first":
        hands.ask((STEP,))
        hands.play()
    if way == "rebased":
        hands.tick[0] += 1
        now = hands.tick[0] * T
        hands.gate.step(Tick("left", hands.tick[0], now, hands.q[0], hands.q[0], (0.0,), rebased=True))
    if way == "reset":
        hands.rest(0, count=2)
        hands.ask((STEP,))
        hands.play()
        hands.rest(0)
        (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
        assert hands.gate.step(Reset(stop.id, "x"))[0].accepted
    hands.ask((STEP,))
    assert hands.held[0].key.last_played == -1
    assert hands.held[0].key.resets == (way == "reset")


@pytest.mark.parametrize(("over", "outcome"), [(1e-13, Outcome.ADMITTED), (1e-11, Outcome.LIMITED)])
def test_a_wish_that_is_over_a_bound_by_rounding_is_admitted(over, outcome):
    most = 4.0 * T * T
    verdict = pair(1.0).ask((most + over,))
    assert (verdict.outcome, bool(verdict.reasons)) == (outcome, outcome is not Outcome.ADMITTED)
    assert verdict.dq == (pytest.approx(most, abs=1e-15),)


def test_a_robot_does_not_rest_while_any_joint_has_way_left():
    hands = ScriptedGate(scenes.lane())
    hands.ask((1e-4, 0.0))
    (stop,) = hands.gate.step(Stop(("A",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
