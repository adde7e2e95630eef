"""Exact behaviour of the gate by hand: ages, reservations, faults, counts and warnings."""

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


def test_a_command_may_be_as_old_as_configured_and_not_older():
    scripted = pair()
    scripted.rest(0, count=5)
    oldest = scripted.cell.config.max_age_ticks
    assert scripted.command((0.0,), based_on=5 - oldest - 1).reasons[0].cause is Cause.STALE
    assert scripted.command((0.0,), based_on=5 - oldest).outcome is Outcome.ADMITTED
    scripted.rest()
    assert scripted.command((0.0,)).outcome is Outcome.ADMITTED


def test_a_robot_can_be_commanded_again_after_its_tick():
    scripted = pair()
    assert scripted.command((0.0,)).target == 1
    assert scripted.command((0.0,)).reasons[0].cause is Cause.OCCUPIED
    scripted.rest()
    assert scripted.command((0.0,)).target == 2


def test_a_path_away_counts_only_after_the_link_has_accepted_it():
    """Before the answer the pair is as near as on the old path; after it as far as on the new one."""
    scripted = pair()
    before = scripted.lowest_bound()
    plan = scripted.command((-STEP,), answer=None)
    assert plan.outcome is Outcome.ADMITTED
    assert scripted.lowest_bound() == scripted.lowest_bound(1) <= before
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, True))
    assert (
        before - 1.01 * STEP <= scripted.lowest_bound() == scripted.lowest_bound(1) <= before
    )  # it has not moved
    scripted.play()
    scripted.rest(0, count=2)
    scripted.command((0.0,), i=1)
    assert scripted.view().setpoint == (scripted.q[0][0],)


def test_a_path_toward_counts_from_the_verdict_until_the_link_refuses_it():
    scripted = pair()
    before = scripted.lowest_bound()
    assert scripted.command((STEP,), answer=None).outcome is Outcome.ADMITTED
    assert scripted.lowest_bound() == pytest.approx(before - STEP, abs=1e-8)
    assert scripted.lowest_bound(1) == scripted.lowest_bound()
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, True))
    assert scripted.lowest_bound() == pytest.approx(before - STEP, abs=1e-8)


def test_two_paths_toward_each_other_count_together_in_any_order_of_the_answers():
    for order in ((0, 1), (1, 0)):
        scripted = pair()
        before = scripted.lowest_bound()
        scripted.command((STEP,), 0, answer=None)
        scripted.command((-STEP,), 1, answer=None)
        for i in order:
            scripted.gate.step(PlanAnswer(scripted.names[i], scripted.held[i].key, True))
        assert scripted.lowest_bound(0) == scripted.lowest_bound(1) <= before - 2 * STEP + 1e-9
        assert scripted.lowest_bound() >= before - 2 * STEP - 1e-8


def test_the_space_of_a_dropped_plan_is_free_for_the_other_robot():
    """With room for one, the link refuses the first plan, and after a new proof the second robot may move."""
    scripted = pair(0.02 + 1.5 * STEP)
    assert scripted.command((STEP,), 0, answer=None).outcome is Outcome.ADMITTED
    assert scripted.command((-STEP,), 1).outcome is Outcome.REFUSED
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, False, "late"))
    scripted.rest(0)
    scripted.rest(1)
    assert scripted.view().late == 1
    assert scripted.command((-STEP,), 1).outcome is Outcome.ADMITTED


def test_each_of_three_robots_keeps_clear_of_both_others():
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


def test_the_applied_sequence_number_is_that_of_the_played_command():
    scripted = pair()
    verdict = scripted.command((STEP,))
    assert verdict.setpoint == (scripted.q[0][0] + STEP,)
    assert scripted.view().applied_seq is None
    scripted.play()
    assert scripted.view().applied_seq == 1
    assert (scripted.view().tick, scripted.view().time) == (1, T)
    scripted.command((0.0,), answer=None)
    scripted.rest()
    assert scripted.view().applied_seq == 1
    assert scripted.view().late == 1


def test_verdicts_are_counted_by_outcome_and_last_cause():
    scripted = pair()
    scripted.command((0.0,))
    scripted.rest()
    scripted.command((1.0,))
    scripted.command((0.0,))
    scripted.command((0.0,))
    assert scripted.view().counts == {"admitted": 1, "limited:acceleration": 1, "refused:occupied": 2}


def test_a_plan_played_out_of_order_is_a_fault():
    scripted = pair()
    scripted.command((STEP,))
    plan = scripted.held[0]
    wrong = Tick("left", 1, T, scripted.q[0], (scripted.q[0][0] + STEP,), (STEP,), plan.key, 1)
    (stopped,) = scripted.gate.step(wrong)
    assert (stopped.robots, stopped.by) == (("left",), "gate")
    assert "the gate did not send" in stopped.reason


def test_after_a_plan_played_out_of_order_the_rest_of_the_held_plan_stays_reserved():
    scripted = pair()
    for k in range(1, 5):
        scripted.command((k * 6e-5,))
        scripted.play()
    plan, before = scripted.held[0], scripted.q[0][0]
    assert len(plan.increments) > 2
    (u,) = plan.increments[1]
    number = scripted.tick[0] + 1
    scripted.gate.step(Tick("left", number, number * T, (before,), (before + u,), (u,), plan.key, 7))
    assert scripted.gate._robots[0].played == 0
    assert scripted.view().stop_end[0] > before + u


def test_a_fault_at_the_first_tick_does_not_widen_the_tube():
    cell = scenes.head_on(1.0, (T, T))
    gate = Gate(cell, "s")
    stopped = gate.step(Tick("left", 0, 0.0, (-0.5,), (-0.5,), (STEP,)))[0]
    assert stopped.robots == ("left",)
    assert gate._robots[0].main.occupied.tube == (0.0,)


def test_a_new_initial_setpoint_of_a_link_is_proven_anew():
    """A link that is not ready may begin anew. The robot is then assumed to move to that setpoint."""
    scripted = pair()
    before, (x,) = scripted.lowest_bound(), scripted.q[0]
    scripted.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    assert scripted.gate.step(Tick("left", 1, T, (x,), (x + 0.05,), (0.0,), rebased=True)) == []
    assert scripted.lowest_bound() == scripted.lowest_bound(1) == pytest.approx(before - 0.05, abs=1e-8)


def test_a_robot_with_an_unusable_tick_does_not_count_as_resting_until_its_next_tick():
    scripted = pair()
    (stop,) = scripted.gate.step(Tick("left", 1, T, (float("nan"),), scripted.q[0], (0.0,)))
    assert scripted.gate.step(Tick("left", 1, T, (float("nan"),), scripted.q[0], (0.0,))) == []
    assert scripted.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    scripted.rest(0)
    assert scripted.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


def test_an_unknown_plan_is_a_fault():
    scripted = pair()
    other = pair()
    other.command((STEP,))
    (stopped,) = scripted.gate.step(
        Tick("left", 1, T, scripted.q[0], (scripted.q[0][0] + STEP,), (STEP,), other.held[0].key, 0)
    )
    assert "the gate did not send" in stopped.reason


@pytest.mark.parametrize(
    ("off", "fault"), [(0.5e-9, False), (1e-9, False), (1.001e-9, True), (2e-9, True), (-2e-9, True)]
)
def test_a_setpoint_other_than_the_sum_of_the_increments_is_a_fault(off, fault):
    scripted = ScriptedGate(scenes.head_on(1.0, (T, T)), [(0.0,), (0.6,)])
    out = scripted.gate.step(Tick("left", 1, T, scripted.q[0], (scripted.q[0][0] + off,), (0.0,)))
    assert (out != []) == fault


def test_the_distances_off_the_path_are_added_up_and_reported():
    scripted = pair(1.0)
    x = scripted.q[0][0]
    (stopped,) = scripted.rest(0, (x + 0.03,))
    assert "0.03 rad or m off its stop path" in stopped.reason
    state = scripted.gate._robots[0]
    assert state.off_path == pytest.approx(0.03)
    assert scripted.rest(0, (x + 0.1,)) == []  # a stopped robot is not stopped again
    assert state.off_path == pytest.approx(0.03 + 0.07)
    assert all(e >= 0.03 for e in state.main.occupied.tube)


def test_braking_that_exceeds_a_lowered_speed_bound_is_admitted_without_reasons():
    scripted = ScriptedGate(scenes.head_on(3.0, (T, T)))
    for _ in range(2):  # to twice the deceleration per tick, so that the braking has no rounding
        assert scripted.command((T,)).outcome is Outcome.LIMITED
        scripted.play()
    scripted.gate.step(LeaseChange("left", 1, 0.01))
    state = scripted.gate._robots[0]
    verdict = scripted.command(state.brake)
    assert state.brake[0] > 0.01 * T
    assert (verdict.outcome, verdict.dq, verdict.reasons) == (Outcome.ADMITTED, state.brake, ())


def test_a_tick_that_only_contradicts_the_plan_adds_no_distance_off_the_path():
    scripted = ScriptedGate(scenes.head_on(1.2, (T, T), tolerance=0.01))
    (x,) = scripted.q[0]
    (stopped,) = scripted.gate.step(Tick("left", 1, T, (x + 0.005,), (x + 1e-6,), (0.0,)))
    assert "add up" in stopped.reason
    assert scripted.gate._robots[0].off_path == 0.0


def test_a_measurement_at_the_edge_of_the_occupancy_is_moved_inside():
    scripted = ScriptedGate(scenes.head_on(1.2, (T, T), tolerance=0.01))
    (x,) = scripted.q[0]
    assert scripted.rest(0, (x + 0.015,)) == []
    state = scripted.gate._robots[0]
    assert state.measured == (x + 0.015,)
    assert abs(state.q[0] - x) <= 0.01


def test_a_fault_stops_robots_that_it_may_meet_unless_they_are_stopped_already():
    scripted = pair(0.1)
    first = scripted.gate.step(Stop(("right",), "x", "y"))[0].id
    out = scripted.rest(0, (scripted.q[0][0] + 0.09,))
    assert [o.robots for o in out] == [("left",)]
    assert scripted.view(1).stops == (first,)


def test_a_fault_far_from_others_stops_no_other_robot():
    scripted = pair(1.0)
    out = scripted.rest(0, (scripted.q[0][0] + 0.09,))
    assert [o.robots for o in out] == [("left",)]


def test_stops_are_numbered_and_a_reset_frees_all_stopped_robots():
    scripted = pair()
    (one,) = scripted.gate.step(Stop(("left", "right"), "x", "y"))
    (two,) = scripted.gate.step(Stop(("right",), "x", "y"))
    assert (one.id, two.id) == (1, 2)
    assert isinstance(one, Stopped)
    scripted.rest(0)
    scripted.rest(1)
    out = scripted.gate.step(Reset(one.id, "x"))
    assert out[0] == ResetAnswer(one.id, True)
    assert [o.robot for o in out[1:] if isinstance(o, Rebase)] == ["left"]
    assert (scripted.view(0).stops, scripted.view(1).stops) == ((), (2,))


def test_a_reset_by_the_id_of_a_repeated_stop_reports_the_id_that_it_lifts():
    scripted = pair()
    first, second = (scripted.gate.step(Stop(("left",), "x", "y"))[0] for _ in range(2))
    assert second.replaces == first.id
    assert scripted.gate.step(Reset(first.id, "y"))[0] == ResetAnswer(first.id, True, lifted=second.id)


def test_a_reset_needs_rest_of_all_robots_that_it_frees():
    scripted = pair()
    scripted.command((STEP,), 1)
    (stop,) = scripted.gate.step(Stop(("left", "right"), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    scripted.play(1)
    scripted.rest(1, count=3)
    assert scripted.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


def test_a_robot_whose_link_was_lost_does_not_count_as_resting_until_its_next_tick():
    scripted = pair()
    (stop,) = scripted.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    assert scripted.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    scripted.rest(0)
    assert scripted.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)
    assert scripted.gate.step(LinkChange("right", LinkState.WAITING)) == []


def test_no_robot_moves_before_every_robot_has_sent_a_tick():
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


@pytest.mark.parametrize(
    ("gaps", "queries", "warnings"), [(0, 0, 0), (1, 1000, 0), (1, 999, 1), (3, 2999, 1)]
)
def test_more_than_one_gap_in_a_thousand_queries_is_reported(gaps, queries, warnings):
    scripted = pair()
    certifier = scripted.gate._clearance.certifier
    certifier.gaps, certifier.queries = gaps, queries
    assert len(scripted.gate.warnings()) == warnings
    assert all(f"{gaps} of {queries}" in text for text in scripted.gate.warnings())


def test_the_least_clearance_is_the_smallest_distance_to_other_bodies_over_all_ticks():
    scripted = pair(0.1)
    scripted.rest()
    first = scripted.view().least_clearance
    assert first == pytest.approx(0.1, abs=1e-6)
    scripted.command((STEP,))
    scripted.play()
    scripted.rest()
    least = scripted.view().least_clearance
    assert least == pytest.approx(0.1 - STEP, abs=1e-6)
    scripted.command((-STEP,))
    scripted.play()
    scripted.rest()
    assert scripted.view().least_clearance == least


def test_a_delayed_robot_keeps_the_setpoints_of_its_window_reserved():
    """Each old setpoint counts until the window has passed since it was replaced."""
    cell = scenes.crossing(window=0.036, periods=(0.012, 0.004))
    scripted = ScriptedGate(cell)
    scripted.command((5e-4, 0.0))
    scripted.play()
    start = (-0.5, 0.0)
    seen = []
    for _ in range(5):
        scripted.rest(0, start)
        seen.append(start in [q for _, q in scripted.gate._robots[0].history])
    assert seen == [True, True, True, False, False] or seen == [True, True, False, False, False]
    state = scripted.gate._robots[0]
    assert max(until for until, _ in state.history) == pytest.approx(state.time)


def test_a_robot_has_no_position_before_its_first_tick_and_nearest_pairs_after_it():
    gate = Gate(scenes.lane(), "s")
    view = gate.view("A")
    assert (view.tick, view.time, view.q, view.setpoint, view.stop_end) == (0, 0.0, (), (), ())
    assert (view.nearest, view.least_clearance) == ((), None)
    gate.step(Tick("A", 0, 0.0, (-1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)))
    (near,) = gate.view("A").nearest
    assert near.distance == pytest.approx(1.45, abs=1e-6)
    assert gate.view("A").least_clearance == near.distance


def test_the_state_contains_the_three_nearest_pairs():
    around = {f"ball_{k}": {"shape": {"sphere": 0.1}, "xyz": [0.5 + 0.1 * k, 0, 0]} for k in range(5)}
    robot = {"urdf": scenes.cart((1, 0, 0)), "start": [-0.5]}
    scripted = ScriptedGate(scenes.build({"A": robot}, surroundings=around))
    assert [n.pair[1] for n in scripted.view().nearest] == ["ball_0", "ball_1", "ball_2"]


def test_the_least_clearance_is_to_other_bodies_and_measured_by_the_engine():
    """Its own arms are nearest to each other; bounds without an engine query are loose."""
    scripted = ScriptedGate(scenes.tree(), [(1.5, -0.3, 0.0, 0.3, 0.0)])
    view = scripted.view()
    own = [n for n in view.nearest if {x.split("/")[0] for x in n.pair} == {"A"}]
    others = [n for n in view.nearest if n not in own]
    assert min(n.distance for n in own) < min(n.distance for n in others)
    assert view.least_clearance == min(n.distance for n in others if n.points is not None)


@pytest.mark.parametrize("event", ["first", "rebased", "reset"])
def test_a_plan_after_a_tick_without_a_plan_replaces_no_plan(event):
    scripted = pair()
    if event != "first":
        scripted.command((STEP,))
        scripted.play()
    if event == "rebased":
        scripted.tick[0] += 1
        now = scripted.tick[0] * T
        scripted.gate.step(
            Tick("left", scripted.tick[0], now, scripted.q[0], scripted.q[0], (0.0,), rebased=True)
        )
    if event == "reset":
        scripted.rest(0, count=2)
        scripted.command((STEP,))
        scripted.play()
        scripted.rest(0)
        (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
        assert scripted.gate.step(Reset(stop.id, "x"))[0].accepted
    scripted.command((STEP,))
    assert scripted.held[0].key.last_played == -1
    assert scripted.held[0].key.resets == (event == "reset")


@pytest.mark.parametrize(("over", "outcome"), [(1e-13, Outcome.ADMITTED), (1e-11, Outcome.LIMITED)])
def test_an_increment_that_exceeds_a_bound_by_rounding_is_admitted(over, outcome):
    most = 4.0 * T * T
    verdict = pair(1.0).command((most + over,))
    assert (verdict.outcome, bool(verdict.reasons)) == (outcome, outcome is not Outcome.ADMITTED)
    assert verdict.dq == (pytest.approx(most, abs=1e-15),)


def test_a_robot_does_not_rest_while_any_joint_still_moves():
    scripted = ScriptedGate(scenes.lane())
    scripted.command((1e-4, 0.0))
    (stop,) = scripted.gate.step(Stop(("A",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
