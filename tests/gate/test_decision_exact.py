"""Reduction of an increment near a body: one budget, few trials, and the reported numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from armgate.events import Cause, Outcome, Plan, PlanKey, Reset
from armgate.gate import decision as decisions
from armgate.gate.clearance import ClearanceResult
from armgate.gate.clearance.pair_check import Binding
from armgate.gate.joint_limits import LimitedIncrement
from armgate.gate.occupancy import occupancy_to
from armgate.gate.retreat import Requirements
from gate import scenes
from gate.rig import Rig
from gate.scripted_gate import STEP, ScriptedGate


def lane_scripted(x, response="stop", **cell):
    cell = scenes.lane(response=response, **cell)
    return ScriptedGate(cell, [(x, 0.0)])


def queries(scripted):
    return scripted.gate._clearance.certifier.queries


@pytest.mark.parametrize("response", ["stop", "slow"])
def test_all_trials_of_a_command_share_one_budget(response, monkeypatch):
    """An arm among wires at full speed: the queries of all trials together stay within the budget."""
    cell = scenes.wire(response=response)
    rng = np.random.default_rng(1)
    rig = Rig(cell, stops=0.0)
    most, bound = 0, 0
    monkeypatch.setattr(decisions, "BUDGET", 5)
    for k in range(250):
        before = queries(rig)
        robot = rig.cell.robots[0]
        if k % 30 == 0:
            u = robot.velocity * robot.period * rng.choice((-1.0, 1.0), 4)
        bound += Cause.CLEARANCE in [r.cause for r in rig.command(0, u).reasons]
        most = max(most, queries(rig) - before)
        for _ in range(rig.every[0]):
            rig.step()
    rig.check()
    assert rig.tally.violations == []
    assert bound > 0
    assert 1 < most <= 5 + 1  # and one query for the witness points of a refusal


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_slow_uses_the_available_room(share):
    wanted = 0.00057
    scripted = lane_scripted(0.4 - share * wanted, "slow")
    verdict = scripted.command((wanted, 0.0))
    assert verdict.outcome is Outcome.LIMITED
    assert 0.9 * share <= verdict.beta <= share
    assert verdict.dq == (pytest.approx(verdict.beta * wanted), 0.0)
    assert [r.cause for r in verdict.reasons] == [Cause.CLEARANCE]
    assert verdict.reasons[0].value == pytest.approx(0.05 - (1.0 - share) * wanted, abs=1e-6)
    again = lane_scripted(0.4 - share * wanted, "stop").command((wanted, 0.0))
    assert (again.outcome, again.beta, again.dq) == (Outcome.REFUSED, 0.0, (0.0, 0.0))


def test_the_blends_of_limits_and_clearance_are_multiplied():
    """The result is the limits' blend times that of clearance, with reasons in the order of the checks."""
    scripted = lane_scripted(0.4 - 0.0002, "slow")
    verdict = scripted.command((0.1, 0.0))
    assert [r.cause for r in verdict.reasons] == [Cause.INCREMENT, Cause.ACCELERATION, Cause.CLEARANCE]
    assert 0.0 < verdict.dq[0] < 0.0002
    assert verdict.beta == pytest.approx(verdict.dq[0] / (4 * 0.012**2))


def test_a_request_below_the_braking_increment_gets_the_braking_increment():
    scripted = ScriptedGate(scenes.head_on(1.1, (0.004, 0.004)))
    scripted.command((STEP,))
    scripted.play()
    verdict = scripted.command((0.0,))
    assert verdict.outcome is Outcome.ADMITTED
    assert verdict.dq == (0.0,)


def test_a_refused_robot_continues_to_brake_along_its_plan():
    """At full speed toward the wall, refusals play the rest of the plan, increment by increment."""
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([-0.3, 0.0])])
    last = None
    for _ in range(2000):
        rig.step(lambda rig, i: (0.012, 0.0))
        verdict = rig.last_verdict[0]
        if verdict is None or verdict is last:
            continue
        last = verdict
        if verdict.outcome is Outcome.REFUSED and rig.players[0].plan is not None:
            rest = rig.players[0].plan.increments[rig.players[0].index + 1 :]
            assert verdict.dq == (rest[0] if rest else (0.0, 0.0))
            assert verdict.beta == 0.0
            break
    assert last.outcome is Outcome.REFUSED


def test_a_joint_outside_its_limits_must_move_back_also_with_slow_while_another_joint_moves():
    rig = Rig(scenes.lane(response="slow"), stops=0.0, start=[np.array([-1.0, 2.1])])
    verdict = rig.command(0, (-1e-4, 0.0))
    assert verdict.outcome is Outcome.REFUSED
    assert verdict.reasons[-1].joint == "J1"
    assert verdict.beta == 0.0


def test_a_kept_bound_suffices_for_the_next_step_without_an_engine_query():
    """Far from the wall no engine is queried, and the kept bound falls by the length of the step."""
    scripted = lane_scripted(-1.0)
    before = queries(scripted)
    scripted.command((4 * 0.012**2 * 0.9, 0.0))
    assert queries(scripted) == before


# --- smaller increments: the secant of the margin -----------------------------------------------------------

POINTS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def bound_by(scripted, margin):
    """Return a maker of bindings of the first pair, whose kept bound exceeds its limit by ``margin``."""
    clearance = scripted.gate._clearance
    clearance.bound[0] = clearance.limits[0] + margin
    return lambda lb: Binding(0, clearance.limits[0] + lb, clearance.limits[0], POINTS)


@pytest.mark.parametrize(
    ("held", "tried", "beta", "found"),
    [
        (0.5, -0.5, 1.0, 0.98 * 0.5),
        (0.5, -0.5, 0.5, 0.98 * 0.25),
        (0.25, -0.75, 1.0, 0.98 * 0.25),
        (0.5, -np.inf, 0.5, 0.25),  # nothing was proven: half
        (0.0, -0.5, 0.5, 0.25),  # the kept margin is zero
        (-0.5, -1.0, 0.5, 0.25),
        (0.5, -0.5, 0.7, 0.98 * 0.35),  # more than half a grid step is rounded away
    ],
)
def test_a_smaller_blend_is_tried_at_the_point_where_the_margin_would_be_used_up(held, tried, beta, found):
    scripted = lane_scripted(-1.0, "slow")
    binding = bound_by(scripted, held)(tried)
    assert scripted.gate._decisions._secant(beta, binding) == math.floor(found * 2**20) / 2**20  # on a grid


@pytest.mark.parametrize(("response", "trials"), [("stop", 1), ("slow", 3)])
def test_an_unproven_increment_is_tried_once_with_stop_and_three_times_with_slow(response, trials):
    scripted = lane_scripted(-1.0, response)
    binding, tried = bound_by(scripted, 0.5)(-0.5), []

    def maker(robot, new, step, need, budget):
        assert budget.left == 32 - len(tried)  # one budget for all trials, as documented
        assert budget.take()
        tried.append(new.nodes[-1][0])
        return ClearanceResult(need, binding)

    scripted.gate._clearance.check = maker
    assert scripted.command((1e-4, 0.0)).outcome is Outcome.REFUSED
    expected = [1e-4, 1e-4 * 0.98 / 2, 1e-4 * (0.98 / 2) ** 2][:trials]
    assert np.array(tried) + 1.0 == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("upper", "outcome"), [(1.2, 0.75), (1.15, 0.0)])
def test_a_smaller_blend_that_would_leave_the_limits_is_not_tried(upper, outcome, monkeypatch):
    """Both ends of a blend stay inside the limits, but an increment between them may leave the limits.

    It stops later than the first end, and is faster than the second.
    """
    scripted = lane_scripted(0.0, "slow")
    maker, s = scripted.gate._decisions, scripted.gate._robots[0]
    s.bounds = replace(s.bounds, upper=(upper, 9.0), decel=(np.inf, 1.0))
    s.held = Plan("A", PlanKey("s", 0, 1, -1), 1, ((1.0, 0.0),))
    wanted, binding = LimitedIncrement((0.5, 3.5), 1.0, ()), bound_by(scripted, 0.5)(-0.5)
    answers = [ClearanceResult(np.zeros(1), binding), ClearanceResult(np.zeros(1), None)]
    monkeypatch.setattr(scripted.gate._clearance, "check", lambda *_: answers.pop(0))
    monkeypatch.setattr(maker, "_secant", lambda beta, binding: 0.75)
    decision = maker._largest_clear(wanted, s, maker._retreat.requirements(s, [s]))
    assert decision.beta == outcome
    assert len(answers) == (outcome == 0.0)


@pytest.mark.parametrize(("response", "trials"), [("stop", 1), ("slow", 3)])
def test_a_retreat_of_axes_that_lag_alike_is_tried_once(response, trials):
    scripted = lane_scripted(0.0, response)
    decisions, s = scripted.gate._decisions, scripted.gate._robots[0]
    need, binding = np.zeros(1), Binding(0, 0.0, 0.05, None)
    assert decisions._trials(s, Requirements(need, (binding,), None)) == 1
    assert decisions._trials(s, Requirements(need, (), None)) == trials


def test_a_new_path_extends_the_held_one_by_the_difference_of_their_ends():
    """The kept bounds do not apply if several paths are held."""
    scripted = lane_scripted(-1.0)
    scripted.command((1e-4, 0.0))
    scripted.play()
    s, maker = scripted.gate._robots[0], scripted.gate._decisions
    new = occupancy_to(s, (-0.75, 0.25), (0.0, 0.0))
    assert maker._extension(s, new) == pytest.approx([0.25 - 1e-4, 0.25])
    s.next = s.main
    assert maker._extension(s, new) is None


def test_a_faster_path_extends_the_held_one_by_the_growth_of_its_lag_tube():
    """A slower path extends it by nothing: the kept bounds hold for the wider tube."""
    scripted = ScriptedGate(scenes.lagging(scenes.lane(), 0.03, 0.4), [(-1.0, 0.0)])
    scripted.command((1e-4, 0.0))
    scripted.play()
    s, maker = scripted.gate._robots[0], scripted.gate._decisions
    share = s.hull_deviation.ticks + s.hull_deviation.between
    faster = occupancy_to(s, s.end, (3e-4, 5e-4))
    assert maker._extension(s, faster) == pytest.approx([2e-4 * share, 5e-4 * share])
    farther = occupancy_to(s, (s.end[0] + 0.25, s.end[1]), (3e-4, 5e-4))
    assert maker._extension(s, farther) == pytest.approx([0.25 + 2e-4 * share, 5e-4 * share])
    slower = occupancy_to(s, s.end, (0.0, 0.0))
    assert maker._extension(s, slower) == pytest.approx([0.0, 0.0])
    assert slower.tube == pytest.approx((1e-4 * share, 0.0))


# --- reasons ------------------------------------------------------------------------------------------------


def test_lengths_in_reasons_are_rounded_to_nanometres_and_bounds_rounded_down():
    scripted = lane_scripted(-1.0)
    maker, s = scripted.gate._decisions, scripted.gate._robots[0]
    points = ((0.12345678949, -0.12345678951, -1e-11), (1.0, -2e-10, 2.0000000004))
    reason = maker._reason(Binding(0, 0.01234567889, 0.05, points), s)
    assert reason.value == 0.012345678
    assert reason.points == ((0.123456789, -0.12345679, 0.0), (1.0, 0.0, 2.0))
    assert [math.copysign(1.0, x) for p in reason.points for x in p] == [1, -1, 1, 1, 1, 1]  # no minus zero


# --- retreats -----------------------------------------------------------------------------------------------


def too_near(between=0.11):
    """Return two balls of 5 cm, 1 cm apart, with a stop distance of 2 cm; ``fast`` has the first turn."""
    cell = scenes.crossing(window=0.0, periods=(0.012, 0.012))
    return ScriptedGate(cell, [(0.0, 0.0), (0.0, between)])


def test_a_robot_that_retreats_keeps_its_turn_for_three_ticks():
    scripted = too_near()
    assert scripted.command((0.0, -2e-4), 0).outcome is not Outcome.REFUSED
    scripted.play(0)
    scripted.rest(0)
    scripted.rest(1)
    assert scripted.command((0.0, 2e-4), 1).outcome is Outcome.REFUSED
    scripted.rest(0, count=2)
    scripted.rest(1)
    assert scripted.command((0.0, 2e-4), 1).outcome is not Outcome.REFUSED


def test_a_robot_found_nearer_after_a_fault_may_retreat_from_that_position():
    """The floor reached before the fault no longer applies."""
    scripted = too_near()
    for _ in range(20):
        scripted.command((0.0, -5e-4), 0)
        scripted.play(0)
    scripted.rest(0, count=5)
    assert scripted.q[0][1] < -0.002
    (stop,) = (one.id for one in scripted.rest(0, (0.0, 0.0)) if one.robots == ("fast",))
    scripted.rest(0, (0.0, 0.0), count=5)
    answer, rebase = scripted.gate.step(Reset(stop, "x"))
    assert (answer.accepted, rebase.setpoint) == (True, (0.0, 0.0))
    for other in scripted.view(1).stops:
        scripted.gate.step(Reset(other, "x"))
    scripted.q[0] = (0.0, 0.0)
    scripted.rest(0, count=2)
    scripted.rest(1, count=2)
    assert scripted.command((0.0, -2e-4), 0).outcome is not Outcome.REFUSED
