"""What is reserved, held in space and proven stays in step through answers, drops, rebases and faults."""

import pytest

from armgate.events import PlanAnswer, Rebase, Reset, ResetAnswer, Stop, Tick
from gate.scripted_gate import STEP, T, pair


def in_step(hands, count):
    """The space holds what the state says, and this many occupancies; returns the state."""
    s = hands.gate._robots[0]
    assert len(s.reserved) == count
    held = hands.gate._clearance.held[0]
    assert [id(one) for one in held] == [id(r.swept) for r in s.reserved]
    return s


def stopped_behind(hands):
    """Left rests measured at its start, one step behind its setpoint, and is reset: residue up to there."""
    start = hands.q[0]
    hands.ask((STEP,))
    hands.play()
    hands.rest(0, start, count=2)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    out = hands.gate.step(Reset(stop.id, "x"))
    assert out[0] == ResetAnswer(stop.id, True)
    assert isinstance(out[1], Rebase)
    hands.q[0] = start
    return start[0]


def test_an_answer_frees_the_old_way():
    hands = pair()
    hands.ask((STEP,), answer=None)
    new = in_step(hands, 2).next
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    s = in_step(hands, 1)
    assert s.main is new
    assert (s.held, s.pending) == (hands.held[0], None)


def test_a_tick_that_plays_the_plan_answers_for_it():
    hands = pair()
    hands.ask((STEP,), answer=None)
    assert hands.play() == []
    s = in_step(hands, 1)
    assert (s.held, s.pending, s.played) == (hands.held[0], None, 0)


def test_a_refusal_leaves_the_old_way_and_nothing_staged():
    hands = pair()
    old = in_step(hands, 1).main
    hands.ask((STEP,), answer=False)
    assert in_step(hands, 1).main is old
    assert hands.gate._reservations._staged == {}


def test_each_tick_reserves_from_what_was_measured():
    hands = pair()
    hands.ask((STEP,))
    hands.play()
    before = in_step(hands, 1).main
    hands.rest()
    s = in_step(hands, 1)
    assert s.main is not before
    assert repr(s.main.occupied) == repr(s.occupancy_to(s.end, s.brake))


def test_an_answer_raises_what_is_proven():
    hands = pair()
    hands.ask((-STEP,), answer=None)
    staged = hands.gate._reservations._staged[0]
    staged += 0.01  # as if the new way were proven to be farther
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    assert hands.kept() == staged.min()


def test_what_waits_for_an_answer_is_no_better_than_what_is_proven_anew():
    hands = pair()
    hands.ask((-STEP,), answer=None)
    reservations = hands.gate._reservations
    staged = reservations._staged[0]
    staged += 0.01
    reservations.prove_anew(hands.gate._robots[0])
    assert staged.min() <= hands.kept()


def test_a_link_that_rebased_nearer_is_proven_there():
    hands = pair()
    before, (x,) = hands.kept(), hands.q[0]
    hands.gate.step(Tick("left", 1, T, (x,), (x + 0.01,), (0.0,), rebased=True))
    assert hands.kept() == hands.kept(1) == pytest.approx(before - 0.01, abs=1e-6)


def test_a_rebase_reserves_both_ways_until_the_link_has_it():
    hands = pair()
    x = stopped_behind(hands)
    s = in_step(hands, 1)
    assert s.main.occupied.nodes == ((x + STEP,), (x,))
    hands.rest()
    assert in_step(hands, 1).main.occupied.nodes == ((x,),)


def test_the_old_setpoint_counts_for_what_is_proven_too():
    hands = pair()
    before = hands.kept()
    x = stopped_behind(hands)
    assert before - STEP - 1e-8 <= hands.kept() <= before - STEP + 1e-8
    hands.rest(0, (x + STEP / 2,))  # it was on its way still
    hands.ask((-STEP,))
    in_step(hands, 1)
    assert hands.kept() <= before - STEP / 2 + 1e-8


@pytest.mark.parametrize("count", [1, 50])
def test_a_link_that_rebases_again_and_again_holds_one_way_only(count):
    """What a decision costs does not grow with them, and what is proven does not fall."""
    hands = pair()
    hands.ask((STEP,))
    hands.play()
    (x,), before = hands.q[0], hands.kept()
    for k in range(count):
        hands.tick[0] += 1
        now, moving = hands.tick[0] * T, (x - STEP * 0.9**k,)
        hands.gate.step(Tick("left", hands.tick[0], now, moving, (x,), (0.0,), rebased=True))
        in_step(hands, 1)
    assert hands.kept() == pytest.approx(before, abs=1e-8)


def test_what_strayed_is_told_from_the_nearest_of_the_ways():
    hands = pair(1.0)
    x = stopped_behind(hands)
    hands.rest(0, (x + STEP + 0.03,))
    assert hands.gate._robots[0].off_path == pytest.approx(0.03, abs=1e-6)


def test_a_reset_after_a_fault_proves_anew_and_the_next_fault_stops_again():
    hands = pair(1.0)
    before, (x,) = hands.kept(), hands.q[0]
    (stop,) = hands.rest(0, (x + 0.03,))
    hands.rest(0, (x + 0.03,))
    assert hands.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)
    in_step(hands, 1)
    assert hands.kept() == pytest.approx(before - 0.03, abs=1e-6)
    hands.q[0] = (x + 0.03,)
    (again,) = hands.rest(0, (x + 0.09,))
    assert again.robots == ("left",)
