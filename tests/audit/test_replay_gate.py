"""Gate for replays: it decides by its own rules, and its robots move as recorded."""

import math

import numpy as np
import pytest

from armgate.audit.replay_gate import ReplayGate
from armgate.events import (
    Cause,
    Command,
    Outcome,
    Plan,
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
from gate.scripted_gate import STEP, ScriptedGate, T


class Followed:
    """Gate with recorded outputs, and a replay gate that follows them; ``now`` holds its own outputs."""

    def __init__(self, then, now):
        self.gate, self.replay, self.now = Gate(then, "s"), ReplayGate(now, "s", compiled=False), []

    def step(self, event):
        out = self.gate.step(event)
        self.now = self.replay.step_following(event, out)
        return out

    def view(self, robot):
        return self.gate.view(robot)


def followed(gap=0.2, tolerance=(0.0, 0.0), then=(), now=()):
    """Return a scripted gate of two carts ``gap`` apart, and both gates."""
    cells = [
        scenes.head_on(0.1 + gap, (T, T), tolerance=t, **dict(rules))
        for t, rules in zip(tolerance, (then, now), strict=True)
    ]
    both = Followed(*cells)
    return ScriptedGate(cells[0], gate=both), both


def assert_followed(both, reservations=True):
    """Check that both gates have the same state of every robot; reservations may differ after a fault."""
    for s, other in zip(both.gate._robots, both.replay._robots, strict=True):
        assert (s.pending, s.held, s.played) == (other.pending, other.held, other.played)
        assert (s.slot, s.setpoint, s.stops) == (other.slot, other.setpoint, other.stops)
        if reservations:
            assert [r.occupied.nodes for r in s.reserved] == [r.occupied.nodes for r in other.reserved]
    assert both.gate._stops.next == both.replay._stops.next


def outcome(both):
    return next(o for o in both.now if isinstance(o, Verdict)).outcome


STRICT, LOOSE = {"stop_distance": 0.1}, {"stop_distance": 0.01}


# --- its view ----------------------------------------------------------------------------------------


def lane():
    """Return a gate with a cart at its start in front of a wall."""
    gate = ReplayGate(scenes.lane(), "s", compiled=False)
    gate.step(Tick("A", 0, 0.0, (-1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)))
    return gate


def test_the_intended_motion_is_known_from_the_first_tick():
    gate = lane()
    found = gate.intended(Command("A", 1, 1, 0, (1e-4, -1e-4)))
    assert (found.commanded, found.limited, found.share) == ((1e-4, -1e-4), (1e-4, -1e-4), 1.0)
    assert found.end == pytest.approx((-1.0 + 1e-4, -1e-4))
    assert (found.q, found.setpoint, found.last) == ((-1.0, 0.0), (-1.0, 0.0), (0.0, 0.0))
    assert gate.intended(Command("A", 1, 1, 0, (1.0, 0.0))).limited[0] == pytest.approx(4 * 0.012**2)


@pytest.mark.parametrize("dq", [(1e-4,), (1e-4,) * 3, (math.nan, 0.0), (0.0, math.inf)])
def test_an_invalid_increment_has_no_intended_motion(dq):
    assert lane().intended(Command("A", 1, 1, 0, dq)) is None


def test_a_robot_has_no_intended_motion_before_its_first_tick():
    assert ReplayGate(scenes.lane(), "s", compiled=False).intended(Command("A", 1, 1, 0, (0.0, 0.0))) is None


def test_witness_points_are_in_the_order_of_the_pair():
    _, both = followed(1.0)
    left, right = (both.replay._clearance.names(0)[k] for k in (0, 1))
    a, b = both.replay.witness("left", (left, right), (-0.3,))
    assert (a, b) == (pytest.approx((-0.25, 0.0, 0.0), abs=1e-6), pytest.approx((0.5, 0.0, 0.0), abs=1e-6))
    a, b = both.replay.witness("right", (left, right), (0.3,))
    assert (a, b) == (pytest.approx((-0.5, 0.0, 0.0), abs=1e-6), pytest.approx((0.25, 0.0, 0.0), abs=1e-6))
    assert both.replay.witness("left", (right, left), (-0.3,)) is None


def test_witness_points_of_the_surroundings_and_of_a_robot_with_itself():
    gate = lane()
    a, b = gate.witness("A", ("A/L1", "wall"), (0.0, 0.1))
    assert (a[0], b[0]) == (pytest.approx(0.05, abs=1e-6), pytest.approx(0.5, abs=1e-6))
    cell = scenes.tree()
    gate = ReplayGate(cell, "s", compiled=False)
    start = tuple(map(float, cell.robots[0].start))
    gate.step(Tick("A", 0, 0.0, start, start, (0.0,) * 5))
    q = (0.0, -0.3, 0.0, 0.3, 0.0)  # both arms turned inwards by the same angle, so they are mirror images
    hands = [p for p in range(len(cell.pairs)) if set(gate._clearance.names(p)) == {"A/L2", "A/L4"}]
    a, b = gate.witness("A", gate._clearance.names(hands[0]), q)
    assert a[0] == pytest.approx(b[0], abs=1e-4)
    assert a[1] == pytest.approx(-b[1], abs=1e-4)


def test_there_is_no_witness_while_a_position_is_unknown():
    gate = ReplayGate(scenes.head_on(1.1, (T, T)), "s", compiled=False)
    gate.step(Tick("left", 0, 0.0, (-0.55,), (-0.55,), (0.0,)))
    assert gate.witness("left", gate._clearance.names(0), (-0.55,)) is None


# --- recorded outputs ---------------------------------------------------------------------------------------


def test_with_the_same_rules_outputs_and_state_are_identical():
    hands, both = followed()
    for dq, answer in ((STEP, True), (STEP, None), (-STEP, False), (0.0, True)):
        verdict = hands.command((dq,), answer=None)
        assert both.now[0] == verdict
        assert_followed(both)
        if answer is not None:
            hands.gate.step(PlanAnswer("left", hands.held[0].key, answer, "late"))
        assert_followed(both)
        hands.rest() if answer is not True else hands.play()
        assert_followed(both)


def test_a_plan_that_these_rules_refuse_is_held_as_recorded():
    hands, both = followed(0.0999 + 2 * STEP, now=STRICT.items())
    verdict = hands.command((4 * STEP,), answer=None)
    assert (verdict.outcome, outcome(both)) == (Outcome.LIMITED, Outcome.REFUSED)
    assert_followed(both)
    assert len(both.replay._robots[0].reserved) == 2
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    hands.play()
    assert_followed(both)


def test_the_clearance_bound_includes_a_followed_motion_without_a_query():
    """Without a query the kept bound includes the followed motion, so it is known to violate the limit."""
    hands, both = followed(0.1 + 0.5 * STEP, now=STRICT.items())
    clearance = both.replay._clearance
    hands.rest(1)
    assert clearance.below(0) == []
    before = clearance.certifier.queries
    both.replay._follow_command(both.replay._robots[0], 1, None, [plan_of(both, STEP)])
    assert clearance.certifier.queries == before
    assert clearance.below(0) == [0]
    assert clearance.bound[0] == pytest.approx(0.1 - 0.5 * STEP, abs=1e-8)


def plan_of(both, dq):
    """Return the plan that the followed gate would play."""
    verdict, plan = both.gate.step(Command("left", 1, 1, both.gate.view("left").tick, (dq,)))
    assert verdict.outcome is not Outcome.REFUSED
    assert isinstance(plan, Plan)
    return plan


def test_a_plan_that_these_rules_admit_is_not_held_if_it_was_refused():
    hands, both = followed(0.02 + 0.5 * STEP, now=LOOSE.items())
    verdict = hands.command((STEP,), answer=None)
    assert (verdict.outcome, outcome(both)) == (Outcome.REFUSED, Outcome.ADMITTED)
    assert_followed(both)
    assert both.replay._robots[0].pending is None
    assert both.replay._reservations._staged == {}


def test_a_command_that_is_refused_while_a_plan_waits_does_not_change_the_plan():
    hands, both = followed(now=STRICT.items())
    hands.command((STEP,), answer=None)
    plan = hands.held[0]
    assert hands.command((STEP,)).reasons[0].cause is Cause.OCCUPIED
    hands.gate.step(PlanAnswer("left", plan.key, True))
    assert_followed(both)
    hands.play()
    assert both.now == []  # the replay gate expects this motion, so it reports no fault
    assert_followed(both)


@pytest.mark.parametrize("elder", [0, 1])
def test_a_slot_is_used_or_free_as_recorded(elder):
    """Only one gate admits the first command, because it allows older commands; both follow the record."""
    ages = [{"max_age_ticks": n} for n in ((9, 1) if elder == 0 else (1, 9))]
    hands, both = followed(then=ages[0].items(), now=ages[1].items())
    hands.rest(0, count=4)
    first = hands.command((STEP,), based_on=1, answer=None)
    assert (first.target is None) == (elder == 1)
    assert_followed(both)
    second = hands.command((STEP,), answer=None)
    assert [r.cause for r in second.reasons] == ([Cause.OCCUPIED] if elder == 0 else [])
    assert both.now[0].reasons == second.reasons
    assert_followed(both)


def test_a_stop_of_these_rules_only_is_reported_and_not_kept():
    """The tolerance of the replay gate is smaller, so the measured position is a fault only for that gate."""
    hands, both = followed(1.0, tolerance=(0.2, 0.0))
    (x,) = hands.q[0]
    for off in (0.03, 0.1):
        assert hands.rest(0, (x + off,)) == []
        (stopped,) = both.now
        assert (stopped.id, stopped.robots) == (1, ("left",))
        assert_followed(both, reservations=False)
    (stop,) = hands.gate.step(Stop(("left", "right"), "x", "y"))
    assert both.now == [stop]
    assert_followed(both, reservations=False)


def test_a_recorded_stop_is_kept():
    hands, both = followed(1.0, tolerance=(0.0, 0.2))
    (x,) = hands.q[0]
    (stopped,) = hands.rest(0, (x + 0.03,))
    assert isinstance(stopped, Stopped)
    assert both.now == []
    assert_followed(both, reservations=False)
    hands.rest(0, (x + 0.03,), count=2)
    kept = both.replay._clearance.bound[0]
    assert hands.gate.step(Reset(stopped.id, "x"))[0] == ResetAnswer(stopped.id, True)
    assert both.now[0] == ResetAnswer(stopped.id, True)
    assert_followed(both, reservations=False)
    state = both.replay._robots[0]
    assert state.main.occupied.end == state.setpoint == (x + 0.03,)
    assert both.replay._clearance.bound[0] < kept - 0.02


def test_only_the_recorded_one_of_two_stops_is_kept():
    """The replay gate requires a larger distance, so it also stops the neighbour of the faulted robot."""
    hands, both = followed(0.19, now=STRICT.items())
    (stopped,) = hands.rest(0, (hands.q[0][0] + 0.06,))
    assert [o.robots for o in both.now] == [("left",), ("right",)]
    assert_followed(both, reservations=False)
    assert (both.replay._stops.of(0), both.replay._stops.of(1)) == ([stopped.id], [])
    assert np.isfinite(both.replay._clearance.bound[0])


@pytest.mark.parametrize("stricter", [0, 1])
def test_a_recorded_answer_to_a_reset_is_followed(stricter):
    """One gate has received no tick of the robot since its link was lost."""
    hands, both = followed(1.0)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    both.gate._robots[0].untracked, both.replay._robots[0].untracked = stricter == 1, stricter == 0
    accepted = hands.gate.step(Reset(stop.id, "x"))[0].accepted
    assert (accepted, both.now[0].accepted) == ((False, True) if stricter == 1 else (True, False))
    for gate in (both.gate, both.replay):
        gate._robots[0].untracked = False
    assert_followed(both)
    hands.command((STEP,), answer=None)
    assert_followed(both)
    hands.rest(0)
    assert hands.gate.step(Reset(stop.id, "x"))[0].accepted == (stricter == 1)
    assert_followed(both)
