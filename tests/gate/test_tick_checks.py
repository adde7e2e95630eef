"""What a tick may report: every field that a link can get wrong, and what an honest link may say."""

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
    """ScriptedGate whose ticks can be changed before the gate hears of them."""

    def honest(self, i=0, index=0):
        """The tick that plays the held plan's increment; not sent yet."""
        plan, before = self.held[i], self.q[i]
        u = plan.increments[index]
        after = tuple(a + b for a, b in zip(before, u, strict=True))
        number = self.tick[i] + 1
        return Tick(self.names[i], number, number * T, before, after, u, plan.key, index)

    def send(self, tick):
        """Return why it stops its robot; others that the robot may now meet are stopped too."""
        stops = [one for one in self.gate.step(tick) if isinstance(one, Stopped)]
        return [one.reason for one in stops if tick.robot in one.robots]


def link():
    return Link(scenes.head_on(0.3, (T, T)))


def moving(ticks=6):
    """A link in motion with some increments left."""
    hands = link()
    u = 0.0
    for _ in range(ticks):
        u += 6e-5
        hands.ask((u,))
        hands.play()
    return hands


@pytest.mark.parametrize("ahead", [False, True])
def test_a_link_that_plays_what_its_plan_says_is_believed(ahead):
    hands = moving()
    if ahead:
        hands.ask((4e-4,), answer=None)
        assert hands.send(hands.honest()) == []
        return
    for index in range(1, len(hands.held[0].increments)):
        assert hands.play(index=index) == []
    assert hands.rest() == []


@pytest.mark.parametrize("off", [2e-12, 1e-6, -1e-6, 1e-3])
def test_another_increment_is_a_fault_at_once_even_if_the_sum_is_right(off):
    hands = moving()
    tick = hands.honest(index=1)
    u = (tick.increment[0] + off,)
    wrong = replace(tick, increment=u, setpoint=(hands.q[0][0] + u[0],))
    assert hands.send(wrong) == ["left's link plays an increment that its plan does not have"]


def test_another_increment_is_a_fault_after_a_takeover_and_for_the_old_plan():
    for answer in (True, None, False):
        hands = moving()
        old = hands.held[0]
        hands.ask((4.5e-4,), answer=answer)
        if answer is False:
            hands.held[0] = old
        tick = hands.honest(index=1 if answer is False else 0)
        wrong = replace(tick, increment=(1e-4,), setpoint=(hands.q[0][0] + 1e-4,))
        assert len(hands.send(wrong)) == 1


def test_rounding_is_none():
    hands = moving()
    tick = hands.honest(index=1)
    u = (tick.increment[0] + 0.9e-12,)
    assert hands.send(replace(tick, increment=u, setpoint=(tick.setpoint[0] + 1e-12,))) == []
    assert hands.view().setpoint == (hands.q[0][0] + u[0],)  # the gate's own sum


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
def test_each_field_is_held_against_the_plan(change):
    hands = moving()
    assert len(hands.send(replace(hands.honest(index=1), **change))) == 1


def test_a_link_that_ends_its_plan_early_is_faulted():
    hands = moving()
    number = hands.tick[0] + 1
    early = Tick("left", number, number * T, hands.q[0], hands.q[0], (0.0,))
    assert hands.send(early) == ["left's link ends its plan before the robot is at rest"]


def test_a_link_without_a_plan_cannot_move():
    hands = pair()
    moved = Tick("left", 1, T, hands.q[0], (hands.q[0][0] + STEP,), (STEP,))
    out = hands.gate.step(moved)
    assert [one.reason for one in out] == ["left's link plays an increment that its plan does not have"]


# --- links that are not ready ------------------------------------------------------------------------------


@pytest.mark.parametrize("state", [LinkState.LOST, LinkState.WAITING, LinkState.FAULTED])
def test_a_link_that_is_not_ready_does_not_move_its_robot_by_increments_of_its_own(state):
    hands = link()
    hands.gate.step(LinkChange("left", state, "gone"))
    tick = Tick("left", 1, T, hands.q[0], (hands.q[0][0] + STEP,), (STEP,))
    assert hands.send(tick) == ["left's link plays an increment that its plan does not have"]


def test_a_link_that_is_not_ready_does_not_lead_the_setpoint_out_of_its_limits():
    hands = link()
    hands.gate.step(LinkChange("left", LinkState.WAITING))
    stops, x = [], hands.q[0][0]
    for k in range(1, 1000):
        x -= T
        stops += hands.send(Tick("left", k, k * T, (x,), (x,), (-T,)))
    assert stops


@pytest.mark.parametrize("increment", [(0.0,), (STEP,)])
@pytest.mark.parametrize("plan", [None, OTHER])
@pytest.mark.parametrize("index", [-1, 0])
@pytest.mark.parametrize("rebased", [False, True])
def test_a_first_tick_tells_of_a_robot_at_rest(increment, plan, index, rebased):
    hands = link()
    hands.gate = Gate(hands.cell, "s")
    first = Tick("left", 0, 0.0, hands.q[0], hands.q[0], increment, plan, index, rebased)
    moves = any(increment) or plan is not None or index != -1
    assert hands.send(first) == (["left's link begins with a robot in motion"] if moves else [])


def test_a_leap_in_a_first_tick_leads_to_none():
    """The acceleration bound counts from the last increment: what a link invents there is no bound."""
    hands = link()
    hands.gate = Gate(hands.cell, "s")
    hands.send(Tick("left", 0, 0.0, hands.q[0], hands.q[0], (1.0,)))
    hands.send(Tick("right", 0, 0.0, hands.q[1], hands.q[1], (0.0,)))
    for name in hands.names:
        hands.gate.step(LinkChange(name, LinkState.READY))
        hands.gate.step(LeaseChange(name, 1))
    assert hands.ask((0.0,)).outcome == "refused"
    assert all(abs(u) <= T for u in hands.ask((0.0,)).dq)


def test_a_link_that_is_lost_plays_what_it_still_has_of_its_plan():
    hands = moving()
    hands.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    number = hands.tick[0] + 1
    wrong = Tick("left", number, number * T, hands.q[0], (hands.q[0][0] + STEP,), (STEP,))
    assert hands.send(wrong) == ["left's link ends its plan before the robot is at rest"]


# --- held robots ------------------------------------------------------------------------------------------


def held(hands, at, **changes):
    number = hands.tick[0] + 1
    tick = Tick("left", number, number * T, hands.q[0], at, (0.0,), rebased=True)
    return replace(tick, **changes)


def test_a_held_robot_is_where_it_was_sent_or_one_increment_before():
    for back in (0, 1):
        hands = moving()
        before = hands.q[0][0] - back * hands.gate._robots[0].last[0]
        assert hands.send(held(hands, (before,))) == []
        assert hands.view().setpoint == pytest.approx((before,), abs=1e-12)


@pytest.mark.parametrize(
    "changes",
    [{"setpoint": (-0.05,)}, {"setpoint": (0.4,)}, {"increment": (STEP,)}, {"plan": OTHER}, {"index": 0}],
)
def test_a_held_robot_is_nowhere_else_and_does_not_move(changes):
    hands = moving()
    assert len(hands.send(held(hands, hands.q[0], **changes))) == 1


def test_the_next_increment_counts_from_where_the_robot_was_held():
    hands = moving()
    hands.send(held(hands, hands.q[0]))
    hands.tick[0] += 1
    hands.ask((STEP,))
    assert hands.play() == []


def test_a_link_that_is_not_ready_may_begin_anew_at_rest():
    """A KRC's program that is started again counts from where the robot was led meanwhile."""
    hands = link()
    hands.gate.step(LinkChange("left", LinkState.LOST, "gone"))
    shifted = tuple(x + 0.001 for x in hands.q[0])
    reasons = hands.send(held(hands, shifted))
    assert not any("never sent" in text for text in reasons)


def test_after_a_reset_the_link_may_report_the_old_setpoint():
    hands = moving()
    for index in range(1, len(hands.held[0].increments)):
        hands.play(index=index)
    hands.rest(count=2)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    hands.gate.step(Reset(stop.id, "x"))
    assert hands.send(held(hands, hands.q[0])) == []


class Carts(Link):
    """Two carts of two joints; ``fast`` is spoken to, and measured where it began."""

    def __init__(self):
        super().__init__(scenes.crossing(window=0.0, periods=(0.012, 0.012)))
        self.begun = self.q[0]

    def moves(self, *us):
        for u in us:
            assert self.ask(u).outcome == "admitted"
            tick = replace(self.honest(), q=self.begun)
            self.tick[0], self.q[0] = tick.tick, tick.setpoint
            assert self.send(tick) == []
        return self

    def says(self, at, u=(0.0, 0.0), **changes):
        number = self.tick[0] + 1
        return self.send(replace(Tick("fast", number, 0.012 * number, self.begun, at, u), **changes))


def test_a_lagging_robot_may_be_held_at_the_setpoint_before_the_last_but_no_earlier_one():
    """Round a corner, where neither is on the way from the measured position to the setpoint."""
    first, second = (5e-4, 0.0), (0.0, 5e-4)
    x, y = Carts().begun
    assert Carts().moves(first, second).says((x + 5e-4, y), rebased=True) == []
    earlier = Carts().moves(first, second, (0.0, 4.9e-4)).says((x + 5e-4, y), rebased=True)
    assert earlier == ["fast's link reports a robot that is held where it was never sent"]


def test_one_joint_that_moves_is_motion():
    hands = Carts().moves((5e-4, 0.0))
    x, y = hands.q[0]
    assert "held and moves" in hands.says((x, y), (0.0, 1e-4), rebased=True)[0]
    hands = Carts()
    assert "plan does not have" in hands.says((hands.q[0][0] + 1e-4, hands.q[0][1]), (1e-4, 0.0))[0]


def test_a_plan_of_one_joint_is_not_ended_early_either():
    hands = Carts()
    u = 0.0
    for _ in range(4):
        u += 5e-4
        hands.ask((u, 0.0))
        tick = hands.honest()
        hands.tick[0], hands.q[0] = tick.tick, tick.setpoint
        hands.send(tick)
        hands.begun = hands.q[0]
    assert hands.says(hands.q[0]) == ["fast's link ends its plan before the robot is at rest"]


# --- ticks that say nothing -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [{field: value} for field in ("q", "setpoint", "increment") for value in ((math.nan,), (math.inf,), ())]
    + [{field: (x,)} for field in ("q", "setpoint", "increment") for x in (1.001e9, -1e160, 1e308)]
    + [{"time": math.nan}, {"tick": 0}, {"tick": 6}, {"q": (0.0, 0.0)}],
)
def test_a_tick_that_cannot_be_read_stops_its_robot_and_nothing_is_believed_of_it(change):
    hands = moving()
    before = hands.view()
    wrong = replace(hands.honest(index=1), **change)
    assert len(hands.send(wrong)) == 1
    assert hands.send(wrong) == []  # once
    after = hands.view()
    assert (after.q, after.setpoint, after.tick) == (before.q, before.setpoint, before.tick)
    assert hands.ask((STEP,)).outcome == "refused"
    reset = hands.gate.step(Reset(after.stops[0], "x"))
    assert not reset[0].accepted  # it is not known to rest


@pytest.mark.parametrize("field", ["q", "setpoint", "increment"])
@pytest.mark.parametrize("far", [1e9, -1e9])
@pytest.mark.parametrize("compiled", [False, None])
def test_a_slide_that_reports_the_farthest_position_in_range_stops_its_neighbour(field, far, compiled):
    """The lengths of its levers are computed anew, and all bounds are numbers still."""
    arms = {name: {"urdf": scenes.slide(), "base": {"xyz": [x, 0, 0]}, "start": [1.5, 0.2, 0.0]}
            for name, x in (("A", 0.0), ("B", 2.0))}  # fmt: skip
    cell = scenes.build(arms)
    hands = ScriptedGate(cell, gate=Gate(cell, "s", compiled))
    number, q = hands.tick[0] + 1, hands.q[0]
    tick = Tick("A", number, number * cell.robots[0].period, q, q, (0.0,) * 3)
    wrong = replace(tick, **{field: (q[0], far, q[2])})
    robots = [one.robots for one in hands.gate.step(wrong) if isinstance(one, Stopped)]
    assert robots == ([("A",), ("B",)] if field != "increment" else [("A",)])
    assert np.all(np.isfinite(hands.gate._clearance.bound.of(1)))


def test_a_first_tick_that_cannot_be_read_is_no_position():
    hands = link()
    fresh = type(hands.gate)(hands.cell, "s")
    fresh.step(LinkChange("left", LinkState.READY))
    assert len(fresh.step(Tick("left", 0, 0.0, (math.nan,), (0.0,), (0.0,)))) == 1
    assert fresh.view("left").q == ()
