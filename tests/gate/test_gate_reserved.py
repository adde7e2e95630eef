"""Reservations, held space and kept bounds remain consistent after answers, drops, rebases and faults."""

import pytest

from armgate.events import PlanAnswer, Rebase, Reset, ResetAnswer, Stop, Tick
from armgate.gate.occupancy import occupancy_to
from gate.scripted_gate import STEP, T, pair


def consistent(scripted, count):
    """Check that clearance holds the state's reservations, ``count`` of them; return the state."""
    s = scripted.gate._robots[0]
    assert len(s.reserved) == count
    held = scripted.gate._clearance.held[0]
    assert [id(one) for one in held] == [id(r.swept) for r in s.reserved]
    return s


def stopped_behind(scripted):
    """Reset the left robot at rest, measured at its start one step behind its setpoint."""
    start = scripted.q[0]
    scripted.command((STEP,))
    scripted.play()
    scripted.rest(0, start, count=2)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    out = scripted.gate.step(Reset(stop.id, "x"))
    assert out[0] == ResetAnswer(stop.id, True)
    assert isinstance(out[1], Rebase)
    scripted.q[0] = start
    return start[0]


def test_an_accepting_answer_frees_the_old_path():
    scripted = pair()
    scripted.command((STEP,), answer=None)
    new = consistent(scripted, 2).next
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, True))
    s = consistent(scripted, 1)
    assert s.main is new
    assert (s.held, s.pending) == (scripted.held[0], None)


def test_a_tick_that_plays_the_plan_counts_as_its_answer():
    scripted = pair()
    scripted.command((STEP,), answer=None)
    assert scripted.play() == []
    s = consistent(scripted, 1)
    assert (s.held, s.pending, s.played) == (scripted.held[0], None, 0)


def test_after_a_refused_plan_only_the_old_path_is_reserved_and_no_bounds_are_staged():
    scripted = pair()
    old = consistent(scripted, 1).main
    scripted.command((STEP,), answer=False)
    assert consistent(scripted, 1).main is old
    assert scripted.gate._reservations._staged == {}


def test_each_tick_reserves_from_the_measured_position():
    scripted = pair()
    scripted.command((STEP,))
    scripted.play()
    before = consistent(scripted, 1).main
    scripted.rest()
    s = consistent(scripted, 1)
    assert s.main is not before
    assert repr(s.main.occupied) == repr(occupancy_to(s, s.end, s.brake))


def test_an_accepting_answer_raises_the_kept_bounds():
    scripted = pair()
    scripted.command((-STEP,), answer=None)
    staged = scripted.gate._reservations._staged[0]
    staged += 0.01  # as if the new path were proven to be farther
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, True))
    assert scripted.lowest_bound() == staged.min()


def test_staged_bounds_are_no_higher_than_bounds_proven_anew():
    scripted = pair()
    scripted.command((-STEP,), answer=None)
    reservations = scripted.gate._reservations
    staged = reservations._staged[0]
    staged += 0.01
    reservations.prove_anew(scripted.gate._robots[0])
    assert staged.min() <= scripted.lowest_bound()


def test_a_robot_rebased_nearer_is_proven_at_that_position():
    scripted = pair()
    before, (x,) = scripted.lowest_bound(), scripted.q[0]
    scripted.gate.step(Tick("left", 1, T, (x,), (x + 0.01,), (0.0,), rebased=True))
    assert scripted.lowest_bound() == scripted.lowest_bound(1) == pytest.approx(before - 0.01, abs=1e-6)


def test_a_rebase_reserves_both_setpoints_until_the_link_has_it():
    scripted = pair()
    x = stopped_behind(scripted)
    s = consistent(scripted, 1)
    assert s.main.occupied.nodes == ((x + STEP,), (x,))
    scripted.rest()
    assert consistent(scripted, 1).main.occupied.nodes == ((x,),)


def test_the_old_setpoint_counts_for_the_proof_too():
    scripted = pair()
    before = scripted.lowest_bound()
    x = stopped_behind(scripted)
    assert before - STEP - 1e-8 <= scripted.lowest_bound() <= before - STEP + 1e-8
    scripted.rest(0, (x + STEP / 2,))  # it was still moving
    scripted.command((-STEP,))
    consistent(scripted, 1)
    assert scripted.lowest_bound() <= before - STEP / 2 + 1e-8


@pytest.mark.parametrize("count", [1, 50])
def test_repeated_rebases_hold_one_path_only(count):
    """The cost of a decision does not grow with their number, and kept bounds do not fall."""
    scripted = pair()
    scripted.command((STEP,))
    scripted.play()
    (x,), before = scripted.q[0], scripted.lowest_bound()
    for k in range(count):
        scripted.tick[0] += 1
        now, moving = scripted.tick[0] * T, (x - STEP * 0.9**k,)
        scripted.gate.step(Tick("left", scripted.tick[0], now, moving, (x,), (0.0,), rebased=True))
        consistent(scripted, 1)
    assert scripted.lowest_bound() == pytest.approx(before, abs=1e-8)


def test_the_distance_off_the_path_is_that_from_the_nearest_path():
    scripted = pair(1.0)
    x = stopped_behind(scripted)
    scripted.rest(0, (x + STEP + 0.03,))
    assert scripted.gate._robots[0].off_path == pytest.approx(0.03, abs=1e-6)


def test_a_reset_after_a_fault_proves_anew_and_the_next_fault_stops_again():
    scripted = pair(1.0)
    before, (x,) = scripted.lowest_bound(), scripted.q[0]
    (stop,) = scripted.rest(0, (x + 0.03,))
    scripted.rest(0, (x + 0.03,))
    assert scripted.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)
    consistent(scripted, 1)
    assert scripted.lowest_bound() == pytest.approx(before - 0.03, abs=1e-6)
    scripted.q[0] = (x + 0.03,)
    (again,) = scripted.rest(0, (x + 0.09,))
    assert again.robots == ("left",)
