"""Causes and the order of checks, slots, stops and resets, plans without answers, replay."""

import math

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.errors import ModelError
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
    ResetAnswer,
    Stop,
    Stopped,
    Tick,
    Verdict,
)
from armgate.gate import Gate
from gate import scenes
from gate.adversary import Adversary
from gate.rig import HARSH, Rig, Traffic

STEP = (0.0005, 0.0)


@pytest.fixture
def rig():
    return Rig(scenes.lane(), stops=0.0)


class Bare:
    """Gate with one cart at x."""

    def __init__(self, x=-1.0, ready=True, lease=True, ticked=True, **cell):
        self.gate = Gate(scenes.lane(**cell), "s")
        if ticked:
            self.gate.step(Tick("A", 0, 0.0, (x, 0.0), (x, 0.0), (0.0, 0.0)))
        if ready:
            self.gate.step(LinkChange("A", LinkState.READY))
        if lease:
            self.gate.step(LeaseChange("A", 7))
        self.seq = 0

    def command(self, dq=STEP, fence=7, based_on=0):
        self.seq += 1
        verdict, *plans = self.gate.step(Command("A", fence, self.seq, based_on, dq))
        assert isinstance(verdict, Verdict)
        assert all(isinstance(p, Plan) for p in plans)
        return verdict


# Each entry violates one check. Entries are merged in reverse, so that an earlier one overrides a later one.
SPOILED = {
    Cause.LEASE: ({"lease": False}, {}),
    Cause.FENCE: ({}, {"fence": 6}),
    Cause.STOPPED: ({"stop": True}, {}),
    Cause.LINK: ({"ready": False}, {}),
    Cause.AHEAD: ({}, {"based_on": 1}),
    Cause.STALE: ({"age": 9}, {"based_on": 0}),
    Cause.OCCUPIED: ({"taken": True}, {}),
    Cause.LENGTH: ({}, {"dq": (0.0,) * 3}),
    Cause.NOT_FINITE: ({}, {"dq": (math.nan, 0.0)}),
}


def spoiled(*causes):
    setup, command = {}, {}
    for cause in reversed(causes):
        setup |= SPOILED[cause][0]
        command |= SPOILED[cause][1]
    bare = Bare(ready=True, lease=True)
    tick = setup.get("age", 0)
    for k in range(1, tick + 1):
        bare.gate.step(Tick("A", k, 0.012 * k, (-1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)))
    if setup.get("taken"):
        assert bare.command(based_on=tick).outcome is Outcome.ADMITTED
    if setup.get("stop"):
        bare.gate.step(Stop(("A",), "x", "y"))
    if setup.get("lease") is False:
        bare.gate.step(LeaseChange("A", None))
    if setup.get("ready") is False:
        bare.gate.step(LinkChange("A", LinkState.WAITING))
    if Cause.AHEAD in causes:
        command["based_on"] = tick + 1
    return bare, bare.command(**({"based_on": tick} | command))


def test_a_client_that_does_not_hold_the_robot_is_refused_whatever_its_fence_is():
    bare = Bare()
    fence = bare.gate._robots[0].fence
    for sent in (fence, fence + 1):
        (verdict,) = bare.gate.step(Command("A", sent, 1, 0, STEP, holder=False))
        (reason,) = verdict.reasons
        assert (reason.cause, reason.value, reason.bound) == (Cause.FENCE, sent, None)


@pytest.mark.parametrize("cause", SPOILED)
def test_every_check_before_geometry_is_named_and_leaves_the_slot_free(cause):
    bare, verdict = spoiled(cause)
    assert verdict.outcome is Outcome.REFUSED
    assert [r.cause for r in verdict.reasons] == [cause]
    assert (verdict.target, verdict.beta) == (None, 0.0)
    assert verdict.reasons[0].text
    if cause not in (Cause.LEASE, Cause.STOPPED, Cause.LINK, Cause.OCCUPIED):
        tick = SPOILED[cause][0].get("age", 0)
        assert bare.command(based_on=tick).outcome is Outcome.ADMITTED


ORDER = list(SPOILED)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (a, b)
        for k, a in enumerate(ORDER)
        for b in ORDER[k + 1 :]
        if {a, b}
        not in ({Cause.LEASE, Cause.FENCE}, {Cause.AHEAD, Cause.STALE}, {Cause.LENGTH, Cause.NOT_FINITE})
    ],
)
def test_of_two_failing_checks_the_earlier_is_named(first, second):
    _, verdict = spoiled(first, second)
    assert [r.cause for r in verdict.reasons] == [first]


def test_a_dq_of_wrong_length_with_nan_is_refused_for_its_length():
    assert Bare().command((math.nan,) * 3).reasons[0].cause is Cause.LENGTH


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_an_increment_that_is_not_finite_names_its_joint(x):
    (reason,) = Bare().command((0.0, x)).reasons
    assert (reason.cause, reason.joint) == (Cause.NOT_FINITE, "J1")


def test_an_unknown_robot_is_an_error():
    with pytest.raises(ModelError, match="R9"):
        Bare().gate.step(Command("R9", 1, 1, 0, STEP))


def test_before_its_first_tick_a_robot_cannot_be_moved():
    assert Bare(ticked=False).command().reasons[0].cause is Cause.LINK


def test_the_bounds_are_named_in_order():
    verdict = Bare().command((1.0, 0.0))
    assert verdict.outcome is Outcome.LIMITED
    assert [r.cause for r in verdict.reasons] == [Cause.INCREMENT, Cause.ACCELERATION]
    assert verdict.dq[0] == pytest.approx(4 * 0.012**2)
    limit = Bare(-2.0).command((-1e-4, 0.0))
    assert [r.cause for r in limit.reasons] == [Cause.JOINT_LIMIT]


def test_a_refusal_by_clearance_has_numbers_and_uses_the_slot():
    bare = Bare(0.4)
    verdict = bare.command((0.0005, 0.0))
    (reason,) = verdict.reasons
    assert (verdict.outcome, verdict.beta, verdict.dq) == (Outcome.REFUSED, 0.0, (0.0, 0.0))
    assert reason.cause is Cause.CLEARANCE
    assert set(reason.pair) == {"A/L1", "wall"}
    assert reason.bound == 0.05
    assert reason.value < 0.05
    assert verdict.target == 1
    assert bare.command((0.0, 0.0)).reasons[0].cause is Cause.OCCUPIED


def test_a_request_for_the_braking_itself_is_admitted():
    assert Bare(0.4).command((0.0, 0.0)).outcome is Outcome.ADMITTED


def test_slow_admits_a_part_when_stop_refuses():
    slow, stop = Bare(0.3995, response="slow"), Bare(0.3995)
    dq = (0.00057, 0.0)
    assert stop.command(dq).outcome is Outcome.REFUSED
    verdict = slow.command(dq)
    assert verdict.outcome is Outcome.LIMITED
    assert 0.0 < verdict.beta < 1.0
    assert verdict.reasons[-1].cause is Cause.CLEARANCE
    assert verdict.dq[0] == pytest.approx(verdict.beta * 0.00057)


def test_a_plan_begins_with_the_increment_of_the_verdict_and_ends_at_rest(rig):
    for _ in range(200):
        rig.step(lambda rig, i: (0.01, 0.0))
    plan = next(o for out in reversed(rig.outputs) for o in out if isinstance(o, Plan))
    assert len(plan.increments) > 3
    assert plan.increments[0] == rig.last_verdict[0].dq


# --- stops ------------------------------------------------------------------------------------------------


def test_a_stop_brings_the_robot_to_rest_and_only_its_reset_frees_it(rig):
    for _ in range(100):
        rig.step(lambda rig, i: (0.01, 0.0))
    stop = rig.stop("A")
    assert rig.command(0, STEP).reasons[0].cause is Cause.STOPPED
    assert rig.reset(stop) == [ResetAnswer(stop, False, "moving")]
    assert rig.reset(99) == [ResetAnswer(99, False, "unknown")]
    rig.rest()
    for _ in range(10):
        rig.step()
    answer, rebase = rig.reset(stop)
    assert answer == ResetAnswer(stop, True)
    assert isinstance(rebase, Rebase)
    assert rebase.resets == 1
    assert rig.reset(stop) == [ResetAnswer(stop, False, "unknown")]
    assert rig.command(0, STEP).outcome is Outcome.ADMITTED


def test_two_stops_need_two_resets(rig):
    first, second = rig.stop("A"), rig.feed(Stop(("A",), "another reason", "rig"))[0].id
    rig.step()
    assert rig.reset(first) == [ResetAnswer(first, True)]
    assert rig.command(0, STEP).reasons[0].cause is Cause.STOPPED
    assert [type(o) for o in rig.reset(second)] == [ResetAnswer, Rebase]


@pytest.mark.parametrize("state", [LinkState.LOST, LinkState.FAULTED])
def test_a_lost_link_stops_its_robot(state):
    bare = Bare()
    (stopped,) = bare.gate.step(LinkChange("A", state, "unplugged"))
    assert isinstance(stopped, Stopped)
    assert stopped.robots == ("A",)
    assert "unplugged" in stopped.reason
    assert bare.command().reasons[0].cause is Cause.STOPPED


def test_a_rebased_robot_starts_again_from_rest(rig):
    for _ in range(100):
        rig.step(lambda rig, i: (0.01, 0.0))
    rig.feed(rig.players[0].play(rig.now, rig.players[0].setpoint, miss=True))
    verdict = rig.command(0, (1.0, 0.0))
    assert verdict.dq[0] == pytest.approx(4 * 0.012**2)  # as from rest
    assert rig.stopped == []


def test_a_robot_whose_link_does_not_play_its_plan_is_stopped():
    bare = Bare()
    (stopped,) = bare.gate.step(Tick("A", 1, 0.012, (-1.0, 0.0), (-0.999, 0.0), (0.0, 0.0)))
    assert "add up" in stopped.reason


# --- plans without answers --------------------------------------------------------------------------------


def test_a_late_plan_is_counted_and_the_old_one_is_played_to_its_end():
    bare = Bare()
    _, plan = bare.gate.step(Command("A", 7, 1, 0, STEP))
    bare.gate.step(PlanAnswer("A", plan.key, False, "late"))
    view = bare.gate.view("A")
    assert (view.late, view.applied_seq, view.stop_end) == (1, None, (-1.0, 0.0))


def test_an_answer_to_another_plan_changes_nothing():
    bare = Bare()
    _, plan = bare.gate.step(Command("A", 7, 1, 0, STEP))
    before = bare.gate.view("A")
    for resets in (1, 2):
        key = type(plan.key)(plan.key.start, resets, plan.key.target, plan.key.last_played)
        assert bare.gate.step(PlanAnswer("A", key, False, "late")) == []
    assert bare.gate.view("A") == before


@pytest.mark.parametrize("answered", [True, None])
def test_until_the_answer_both_paths_are_reserved(answered):
    """The plan of the fast cart away from the other is not answered: the old path stays reserved."""
    start = [(0.0, 0.0), (0.0, 0.1246)]
    cell = scenes.crossing(window=0.0, periods=(0.012, 0.012))
    gate = Gate(cell, "s")
    for name, q in zip(("fast", "slow"), start, strict=True):
        gate.step(Tick(name, 0, 0.0, q, q, (0.0, 0.0)))
        gate.step(LinkChange(name, LinkState.READY))
        gate.step(LeaseChange(name, 1))
    _, plan = gate.step(Command("fast", 1, 1, 0, (0.0, 0.0005)))  # toward the slow one
    slow = gate.step(Command("slow", 1, 1, 0, (0.0, -0.0002)))[0]
    free = gate.step(Command("slow", 1, 2, 0, (0.0, 0.0002)))[0]
    assert plan is not None
    assert slow.outcome is Outcome.ADMITTED
    assert free.reasons[0].cause is Cause.OCCUPIED
    gate.step(
        PlanAnswer("fast", plan.key, bool(answered))
        if answered
        else PlanAnswer("fast", plan.key, False, "late")
    )
    assert gate.view("fast").stop_end == ((0.0, 0.0005) if answered else (0.0, 0.0))


# --- replay -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("traffic", [Traffic(), HARSH])
def test_a_replay_gives_the_same_outputs(traffic):
    import random

    cell = scenes.planar(response="slow")
    rig = Rig(cell, 3, 0.03, 0.0, traffic, stops=0.0)
    rig.run(Adversary(random.Random(4)), 150)
    gate = Gate(build_cell(cell.config), "rig")
    again = [gate.step(event) for event in rig.events]
    assert again == rig.outputs
    assert repr(again) == repr(rig.outputs)
