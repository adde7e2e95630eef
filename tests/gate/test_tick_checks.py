"""Checks of a tick: every field that a link can get wrong, and everything that a correct link may report."""

import math
from dataclasses import replace

import numpy as np
import pytest

from armgate.events import LeaseChange, LinkChange, LinkState, PlanKey, Reset, Stop, Stopped, Tick
from armgate.gate import Gate
from gate import scenes
from gate.scripted_gate import STEP, ScriptedGate, T, pair

OTHER = PlanKey("s", 0, 1, 5)


class Link(ScriptedGate):
    """Scripted gate whose ticks can be changed before they are sent."""

    def honest(self, i=0, index=0):
        """Return the tick that plays the held plan's increment, without sending it."""
        plan, before = self.held[i], self.q[i]
        u = plan.increments[index]
        after = tuple(a + b for a, b in zip(before, u, strict=True))
        number = self.tick[i] + 1
        return Tick(self.names[i], number, number * T, before, after, u, plan.key, index)

    def send(self, tick):
        """Return the reason of the robot's stop; other robots that it may now meet are stopped too."""
        stops = [one for one in self.gate.step(tick) if isinstance(one, Stopped)]
        return [one.reason for one in stops if tick.robot in one.robots]


def link():
    return Link(scenes.head_on(0.3, (T, T)))


def moving(ticks=6):
    """Return a link in motion with some increments left."""
    scripted = link()
    u = 0.0
    for _ in range(ticks):
        u += 6e-5
        scripted.command((u,))
        scripted.play()
    return scripted


@pytest.mark.parametrize("ahead", [False, True])
def test_a_tick_that_agrees_with_the_plan_is_accepted(ahead):
    scripted = moving()
    if ahead:
        scripted.command((4e-4,), answer=None)
        assert scripted.send(scripted.honest()) == []
        return
    for index in range(1, len(scripted.held[0].increments)):
        assert scripted.play(index=index) == []
    assert scripted.rest() == []


@pytest.mark.parametrize("off", [2e-12, 1e-6, -1e-6, 1e-3])
def test_another_increment_is_a_fault_at_once_even_if_the_setpoint_is_its_sum(off):
    scripted = moving()
    tick = scripted.honest(index=1)
    u = (tick.increment[0] + off,)
    wrong = replace(tick, increment=u, setpoint=(scripted.q[0][0] + u[0],))
    assert scripted.send(wrong) == ["left's link plays an increment that its plan does not have"]


def test_another_increment_is_a_fault_for_the_new_plan_and_for_the_old_plan():
    for answer in (True, None, False):
        scripted = moving()
        old = scripted.held[0]
        scripted.command((4.5e-4,), answer=answer)
        if answer is False:
            scripted.held[0] = old
        tick = scripted.honest(index=1 if answer is False else 0)
        wrong = replace(tick, increment=(1e-4,), setpoint=(scripted.q[0][0] + 1e-4,))
        assert len(scripted.send(wrong)) == 1


def test_rounding_is_not_a_fault():
    scripted = moving()
    tick = scripted.honest(index=1)
    u = (tick.increment[0] + 0.9e-12,)
    assert scripted.send(replace(tick, increment=u, setpoint=(tick.setpoint[0] + 1e-12,))) == []
    assert scripted.view().setpoint == (scripted.q[0][0] + u[0],)  # the gate's own sum


@pytest.mark.parametrize(
    "change",
    [
        {"setpoint": (0.4,)},
        {"index": 2},
        {"index": 0},
        {"index": -1},
        {"plan": OTHER},
        {"plan": None, "index": -1},
        {"plan": None, "index": -1, "increment": (0.0,)},
        {"increment": (0.0,)},
    ],
)
def test_each_field_is_compared_with_the_plan(change):
    scripted = moving()
    assert len(scripted.send(replace(scripted.honest(index=1), **change))) == 1


def test_a_link_that_ends_its_plan_early_is_faulted():
    scripted = moving()
    number = scripted.tick[0] + 1
    early = Tick("left", number, number * T, scripted.q[0], scripted.q[0], (0.0,))
    assert scripted.send(early) == ["left's link ends its plan before the robot is at rest"]


def test_a_link_without_a_plan_cannot_move():
    scripted = pair()
    moved = Tick("left", 1, T, scripted.q[0], (scripted.q[0][0] + STEP,), (STEP,))
    out = scripted.gate.step(moved)
    assert [one.reason for one in out] == ["left's link plays an increment that its plan does not have"]


# --- links that are not ready ------------------------------------------------------------------------------


@pytest.mark.parametrize("state", [LinkState.LOST, LinkState.WAITING, LinkState.FAULTED])
def test_a_link_that_is_not_ready_does_not_move_its_robot_by_increments_of_its_own(state):
    scripted = link()
    scripted.gate.step(LinkChange("left", state, "gone"))
    tick = Tick("left", 1, T, scripted.q[0], (scripted.q[0][0] + STEP,), (STEP,))
    assert scripted.send(tick) == ["left's link plays an increment that its plan does not have"]


def test_a_link_that_is_not_ready_does_not_move_the_setpoint_out_of_its_limits():
    scripted = link()
    scripted.gate.step(LinkChange("left", LinkState.WAITING))
    stops, x = [], scripted.q[0][0]
    for k in range(1, 1000):
        x -= T
        stops += scripted.send(Tick("left", k, k * T, (x,), (x,), (-T,)))
    assert stops


@pytest.mark.parametrize("increment", [(0.0,), (STEP,)])
@pytest.mark.parametrize("plan", [None, OTHER])
@pytest.mark.parametrize("index", [-1, 0])
@pytest.mark.parametrize("rebased", [False, True])
def test_a_first_tick_must_report_a_robot_at_rest(increment, plan, index, rebased):
    scripted = link()
    scripted.gate = Gate(scripted.cell, "s")
    first = Tick("left", 0, 0.0, scripted.q[0], scripted.q[0], increment, plan, index, rebased)
    moves = any(increment) or plan is not None or index != -1
    assert scripted.send(first) == (["left's link begins with a robot in motion"] if moves else [])


def test_an_increment_in_a_first_tick_does_not_allow_a_leap():
    """The acceleration bound counts from the last increment, which a link must not invent."""
    scripted = link()
    scripted.gate = Gate(scripted.cell, "s")
    scripted.send(Tick("left", 0, 0.0, scripted.q[0], scripted.q[0], (1.0,)))
    scripted.send(Tick("right", 0, 0.0, scripted.q[1], scripted.q[1], (0.0,)))
    for name in scripted.names:
        scripted.gate.step(LinkChange(name, LinkState.READY))
        scripted.gate.step(LeaseChange(name, 1))
    assert scripted.command((0.0,)).outcome == "refused"
    assert all(abs(u) <= T for u in scripted.command((0.0,)).dq)


def test_a_lost_link_plays_the_rest_of_its_plan():
    scripted = moving()
    scripted.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    number = scripted.tick[0] + 1
    wrong = Tick("left", number, number * T, scripted.q[0], (scripted.q[0][0] + STEP,), (STEP,))
    assert scripted.send(wrong) == ["left's link ends its plan before the robot is at rest"]


# --- held robots ------------------------------------------------------------------------------------------


def held(scripted, at, **changes):
    number = scripted.tick[0] + 1
    tick = Tick("left", number, number * T, scripted.q[0], at, (0.0,), rebased=True)
    return replace(tick, **changes)


def test_a_held_robot_is_at_its_setpoint_or_one_increment_before():
    for back in (0, 1):
        scripted = moving()
        before = scripted.q[0][0] - back * scripted.gate._robots[0].last[0]
        assert scripted.send(held(scripted, (before,))) == []
        assert scripted.view().setpoint == pytest.approx((before,), abs=1e-12)


@pytest.mark.parametrize(
    "changes",
    [{"setpoint": (-0.05,)}, {"setpoint": (0.4,)}, {"increment": (STEP,)}, {"plan": OTHER}, {"index": 0}],
)
def test_a_held_robot_elsewhere_or_in_motion_is_a_fault(changes):
    scripted = moving()
    assert len(scripted.send(held(scripted, scripted.q[0], **changes))) == 1


def test_the_next_increment_counts_from_the_held_position():
    scripted = moving()
    scripted.send(held(scripted, scripted.q[0]))
    scripted.tick[0] += 1
    scripted.command((STEP,))
    assert scripted.play() == []


def test_a_link_that_is_not_ready_may_begin_anew_at_rest():
    """A restarted program of a KRC counts from the position to which the robot was moved meanwhile."""
    ready, lost = link(), link()
    lost.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    shifted = tuple(x + 0.001 for x in lost.q[0])
    assert len(ready.send(held(ready, shifted))) == 1
    assert lost.send(held(lost, shifted)) == []


def test_after_a_reset_the_link_may_report_the_old_setpoint():
    scripted = moving()
    for index in range(1, len(scripted.held[0].increments)):
        scripted.play(index=index)
    scripted.rest(count=2)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    scripted.gate.step(Reset(stop.id, "x"))
    assert scripted.send(held(scripted, scripted.q[0])) == []


class Carts(Link):
    """Two carts of two joints; ``fast`` gets commands, and is measured at its start."""

    def __init__(self):
        super().__init__(scenes.crossing(window=0.0, periods=(0.012, 0.012)))
        self.begun = self.q[0]

    def moves(self, *us):
        for u in us:
            assert self.command(u).outcome == "admitted"
            tick = replace(self.honest(), q=self.begun)
            self.tick[0], self.q[0] = tick.tick, tick.setpoint
            assert self.send(tick) == []
        return self

    def report(self, at, u=(0.0, 0.0), **changes):
        number = self.tick[0] + 1
        return self.send(replace(Tick("fast", number, 0.012 * number, self.begun, at, u), **changes))


def test_a_lagging_robot_may_be_held_at_the_setpoint_before_the_last_but_no_earlier_one():
    """Around a corner, where neither is on the line from the measured position to the setpoint."""
    first, second = (5e-4, 0.0), (0.0, 5e-4)
    x, y = Carts().begun
    assert Carts().moves(first, second).report((x + 5e-4, y), rebased=True) == []
    earlier = Carts().moves(first, second, (0.0, 4.9e-4)).report((x + 5e-4, y), rebased=True)
    assert earlier == ["fast's link holds its robot at a position that the gate never commanded"]


def test_motion_of_one_joint_is_motion_of_the_robot():
    scripted = Carts().moves((5e-4, 0.0))
    x, y = scripted.q[0]
    assert "held and moves" in scripted.report((x, y), (0.0, 1e-4), rebased=True)[0]
    scripted = Carts()
    assert (
        "plan does not have" in scripted.report((scripted.q[0][0] + 1e-4, scripted.q[0][1]), (1e-4, 0.0))[0]
    )


def test_a_plan_that_moves_one_joint_must_not_end_early():
    scripted = Carts()
    u = 0.0
    for _ in range(4):
        u += 5e-4
        scripted.command((u, 0.0))
        tick = scripted.honest()
        scripted.tick[0], scripted.q[0] = tick.tick, tick.setpoint
        scripted.send(tick)
        scripted.begun = scripted.q[0]
    assert scripted.report(scripted.q[0]) == ["fast's link ends its plan before the robot is at rest"]


# --- unusable ticks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [{field: value} for field in ("q", "setpoint", "increment") for value in ((math.nan,), (math.inf,), ())]
    + [{field: (x,)} for field in ("q", "setpoint", "increment") for x in (1.001e9, -1e160, 1e308)]
    + [{"time": math.nan}, {"tick": 0}, {"tick": 6}, {"q": (0.0, 0.0)}],
)
def test_an_unusable_tick_stops_its_robot_and_changes_nothing_else(change):
    scripted = moving()
    before = scripted.view()
    wrong = replace(scripted.honest(index=1), **change)
    assert len(scripted.send(wrong)) == 1
    assert scripted.send(wrong) == []  # the stop is reported once
    after = scripted.view()
    assert (after.q, after.setpoint, after.tick) == (before.q, before.setpoint, before.tick)
    assert scripted.command((STEP,)).outcome == "refused"
    reset = scripted.gate.step(Reset(after.stops[0], "x"))
    assert not reset[0].accepted  # the gate does not know that the robot is at rest


@pytest.mark.parametrize("field", ["q", "setpoint", "increment"])
@pytest.mark.parametrize("far", [1e9, -1e9])
@pytest.mark.parametrize("compiled", [False, None])
def test_a_slide_that_reports_the_farthest_position_in_range_stops_its_neighbour(field, far, compiled):
    """The lengths of its levers are computed anew, and all bounds are still numbers."""
    arms = {name: {"urdf": scenes.slide(), "base": {"xyz": [x, 0, 0]}, "start": [1.5, 0.2, 0.0]}
            for name, x in (("A", 0.0), ("B", 2.0))}  # fmt: skip
    cell = scenes.build(arms)
    scripted = ScriptedGate(cell, gate=Gate(cell, "s", compiled))
    number, q = scripted.tick[0] + 1, scripted.q[0]
    tick = Tick("A", number, number * cell.robots[0].period, q, q, (0.0,) * 3)
    wrong = replace(tick, **{field: (q[0], far, q[2])})
    robots = [one.robots for one in scripted.gate.step(wrong) if isinstance(one, Stopped)]
    assert robots == ([("A",), ("B",)] if field != "increment" else [("A",)])
    assert np.all(np.isfinite(scripted.gate._clearance.bound.of(1)))


def test_an_unusable_first_tick_gives_no_position():
    scripted = link()
    fresh = type(scripted.gate)(scripted.cell, "s")
    fresh.step(LinkChange("left", LinkState.READY))
    assert len(fresh.step(Tick("left", 0, 0.0, (math.nan,), (0.0,), (0.0,)))) == 1
    assert fresh.view("left").q == ()
