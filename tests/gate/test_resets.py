"""Resets: at rest under noise, at joint limits, with a plan under way, after a push by hand."""

import os

import numpy as np
import pytest

from armgate.events import (
    Cause,
    LinkChange,
    LinkState,
    Outcome,
    PlanAnswer,
    Rebase,
    Reset,
    ResetAnswer,
    Stop,
    Stopped,
    Tick,
)
from gate import scenes
from gate.rig import Rig
from gate.scripted_gate import STEP, ScriptedGate, T, pair


def measured_off(rig, i, off, count=1):
    """Send ticks at which a standing robot is measured with this error."""
    for _ in range(count):
        q = rig.drives[i].q + np.array(off)
        assert rig.feed(rig.players[i].play(rig.now, [float(x) for x in q])) == []


def toward(rig, sign):
    """Move the first joint at full speed until it is as near as allowed; then come to rest."""
    for _ in range(1200):
        rig.step(lambda rig, i: (sign * 0.01, 0.0))
    rig.rest()


@pytest.mark.daily(2)
@pytest.mark.parametrize("tolerance", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_resets_under_noise_never_go_below_the_stop_distance(tolerance, side):
    """At the wall the robot is measured nearer by the tolerance each time: its setpoint must not follow."""
    rig = Rig(scenes.boom(tolerance), stops=0.0)
    toward(rig, side)
    setpoint = rig.players[0].setpoint
    for _ in range(40):
        stop = rig.stop("A")
        measured_off(rig, 0, (side * tolerance, -side * tolerance), 2)
        answer, rebase = rig.reset(stop)
        assert (answer.accepted, rebase.setpoint) == (True, setpoint)
        for _ in range(12):
            rig.step(lambda rig, i: (side * 1e-3, 0.0))
        rig.rest()
        setpoint = rig.players[0].setpoint
    rig.check()
    assert rig.tally.violations == []
    assert rig.tally.least < 1e-3 + 3 * tolerance


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_resets_under_noise_move_no_setpoint_out_of_its_limits(side):
    cell = scenes.boom(1e-3, surroundings={})
    rig = Rig(cell, stops=0.0, start=[np.array([1.2 * side, 0.0])])
    for _ in range(40):
        stop = rig.stop("A")
        measured_off(rig, 0, (side * 1e-3, 0.0))
        _, rebase = rig.reset(stop)
        assert rebase.setpoint == (1.2 * side, 0.0)
        rig.rest()


def test_a_reset_off_the_setpoint_proves_all_pairs_anew():
    """The robot stands a step short of its setpoint, and is reset there."""
    scripted = pair(1.0)
    (x,) = scripted.q[0]
    scripted.command((STEP,))
    scripted.play()
    scripted.rest(0, (x,), count=3)
    kept = scripted.lowest_bound()
    scripted.gate._clearance.bound.lower(0, np.array([0.5 * kept]))  # as if the kept bound were lower
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    answer, rebase = scripted.gate.step(Reset(stop.id, "x"))
    assert (answer.accepted, rebase.setpoint) == (True, (x,))
    proven = []
    check = scripted.gate._clearance.check
    scripted.gate._clearance.check = lambda *given: proven.append(given) or check(*given)
    assert scripted.lowest_bound() == pytest.approx(kept, abs=1e-8)
    scripted.q[0] = (x,)
    scripted.rest(0, count=2)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert proven == []  # it stands at its setpoint: no pair is proven


def test_a_reset_keeps_the_setpoint_if_the_measured_position_cannot_be_proven(monkeypatch):
    scripted = pair()
    (x,) = scripted.q[0]
    scripted.command((STEP,))
    scripted.play()
    scripted.rest(0, (x,), count=3)
    bounds = scripted.lowest_bound()
    clearance = scripted.gate._clearance
    monkeypatch.setattr(clearance.prefilter, "run", lambda *given: (np.array([-1.0]), np.array([0])))
    monkeypatch.setattr(clearance, "_prove", lambda *given: type("F", (), {"lb": -1.0, "points": None}))
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    answer, rebase = scripted.gate.step(Reset(stop.id, "x"))
    assert (answer.accepted, rebase.setpoint, rebase.resets) == (True, scripted.q[0], 1)
    assert scripted.lowest_bound() == bounds


def test_a_reset_moves_the_setpoint_to_a_robot_that_is_too_near_and_did_not_retreat():
    """The robot does not follow its retreat: at its position the proven bound is no higher than before."""
    scripted = pair(0.015)
    (x,) = scripted.q[0]
    assert scripted.command((-STEP,)).outcome is Outcome.ADMITTED
    scripted.play()
    scripted.rest(0, (x,), count=3)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert scripted.lowest_bound() == pytest.approx(0.015, abs=1e-8)


def test_staged_bounds_are_no_higher_than_bounds_proven_by_a_reset():
    scripted = pair()
    (x,) = scripted.q[0]
    scripted.command((STEP,))
    scripted.play()
    scripted.rest(0, (x,), count=3)
    scripted.command((-STEP,), i=1, answer=None)
    staged = scripted.gate._reservations._staged[1]
    staged += 0.01
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert staged.min() <= scripted.lowest_bound()


# --- rest -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4, 1e-3])
def test_a_standing_robot_is_reset_under_noise(tolerance):
    rig = Rig(scenes.boom(tolerance), stops=0.0)
    for k in range(200):
        stop = rig.stop("A")
        measured_off(rig, 0, tolerance * np.array([(-1.0) ** k, 1.0 - k % 3]))
        assert rig.reset(stop)[0].accepted


@pytest.mark.parametrize("late", [0, 1, 5, 20])
def test_a_moving_robot_is_not_reset(late):
    """With a lag of 0.12 s at 1 rad/s it is far from its setpoint for any noise."""
    rig = Rig(scenes.boom(1e-4, surroundings={}), lag=0.12, stops=0.0)
    for _ in range(200):
        rig.step(lambda rig, i: (0.01, 0.0))
    stop = rig.stop("A")
    while rig.players[0].plan is not None:
        rig.step()
    for _ in range(late * rig.every[0]):
        rig.step()
    away = np.abs(rig.drives[0].q - rig.players[0].setpoint).max()
    assert away > 1e-3
    assert rig.reset(stop) == [ResetAnswer(stop, False, "moving")]


@pytest.mark.parametrize("answered", [None, True])
def test_a_robot_with_a_pending_plan_is_not_reset(answered):
    """The link may accept the plan at any time, and would then play a plan that the gate has dropped."""
    scripted = pair()
    scripted.command((STEP,), answer=answered)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    scripted.gate.step(PlanAnswer("left", scripted.held[0].key, True))
    assert scripted.play() == []
    scripted.rest(0)
    assert scripted.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


# --- robots pushed by hand --------------------------------------------------------------------------------


def push(rig, i, q):
    """Move a robot by hand, measure it there until it rests, and return the stop of its fault."""
    rig.expect_faults = True
    drive, player = rig.drives[i], rig.players[i]
    drive.q = np.array(q, dtype=float)
    (stopped,) = [o for o in rig.feed(player.play(rig.now, [float(x) for x in q])) if isinstance(o, Stopped)]
    for _ in range(200):
        rig.feed(player.play(rig.now, [float(x) for x in q]))
    return stopped.id


@pytest.mark.parametrize("deeper", [0.46, 0.4999, 0.52])
def test_a_robot_pushed_deeper_after_a_retreat_may_retreat_again(deeper):
    """A cart with a ball of 5 cm before a wall at 0.5 m, 5 cm to be kept; it had retreated to 0.42 before."""
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.44, 0.0])])
    for _ in range(200):
        rig.step(lambda rig, i: (-1e-4, 0.0))
    rig.rest()
    stop = push(rig, 0, (deeper, 0.0))
    assert rig.command(0, (-1e-4, 0.0)).outcome is Outcome.REFUSED
    assert rig.reset(stop)[0].accepted
    rig.step()
    for _ in range(6):
        rig.step()
    assert rig.command(0, (1e-4, 0.0)).outcome is Outcome.REFUSED
    for _ in range(6):
        rig.step()
    assert rig.command(0, (-1e-4, 0.0)).outcome is not Outcome.REFUSED


def test_only_a_fault_clears_the_floors_of_a_retreat():
    """With repeated stops and resets, a controller does not get nearer by the slack each time."""
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.44, 0.0])])
    for _ in range(100):
        rig.step(lambda rig, i: (-1e-4, 0.0))
    rig.rest()
    reached = rig.drives[0].q[0]
    for _ in range(20):
        assert rig.reset(rig.stop("A"))[0].accepted
        for _ in range(24):
            rig.step(lambda rig, i: (1e-5, 1e-5))
        rig.rest()
    assert rig.drives[0].q[0] <= reached + 2e-4 + 1e-9


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_pushed_out_of_its_limits_may_only_move_back(side):
    rig = Rig(scenes.lane(), stops=0.0)
    stop = push(rig, 0, (-1.0, 2.1 * side))
    _, rebase = rig.reset(stop)
    assert rebase.setpoint == (-1.0, 2.1 * side)
    rig.feed(rig.players[0].play(rig.now, (-1.0, 2.1 * side)))
    verdict = rig.command(0, (-1e-4, 0.0))
    assert (verdict.outcome, verdict.reasons[-1].cause) == (Outcome.REFUSED, Cause.JOINT_LIMIT)
    rig.feed(rig.players[0].play(rig.now, (-1.0, 2.1 * side)))
    assert rig.command(0, (0.0, -1e-4 * side)).outcome is Outcome.ADMITTED


# --- outside the range of the motion bounds ---------------------------------------------------------------


def creep(rig, i):
    """Return increments with the revolute joint at full speed and the slide moving back very slowly."""
    return (0.03, -1e-6, 0.0)


@pytest.mark.daily(3)
@pytest.mark.parametrize("turned", [-1.8, -0.6, 0.0, 1.1])
@pytest.mark.parametrize("beyond", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("configured", [True, False])
def test_motion_bounds_hold_for_a_slide_beyond_its_limit(beyond, turned, configured):
    cell = scenes.lever(0.8 + beyond) if configured else scenes.lever()
    rig = Rig(cell, stops=0.02, start=[np.array([turned, 0.8 + beyond, 0.0])])
    rig.run(creep, 150)
    assert rig.tally.violations == []
    assert rig.tally.accepted > 0.1


@pytest.mark.parametrize("compiled", [False] if os.environ.get("ARMGATE_NUMPY") else [False, True])
def test_motion_bounds_are_widened_for_a_robot_pushed_out_and_narrowed_when_it_is_back(compiled):
    from armgate.gate import Gate

    scripted = ScriptedGate(scenes.lever(), gate=Gate(scenes.lever(), "s", compiled))
    space, before = scripted.gate._clearance.space, scripted.gate._clearance.space.motion[0]
    pairs = scripted.gate._clearance.prefilter.pairs[0]
    (stop,) = [o for o in scripted.rest(0, (0.0, 1.3, 0.0)) if isinstance(o, Stopped)]
    wide = space.motion[0]
    assert (wide >= before).all()
    assert wide[-1, 0] >= before[-1, 0] + 0.4
    assert (scripted.gate._clearance.prefilter.pairs[0].growth >= pairs.growth).all()
    assert scripted.gate._clearance.prefilter.pairs[0].growth[:, 0].max() >= pairs.growth[:, 0].max() + 0.4
    assert scripted.gate._robots[0].main.swept.motion is wide
    scripted.rest(0, (0.0, 1.31, 0.0), count=2)
    assert space.motion[0] is wide  # the range was widened by more than was needed
    _, rebase = scripted.gate.step(Reset(stop.id, "x"))
    scripted.q[0] = rebase.setpoint
    scripted.rest(0)
    (again,) = [o for o in scripted.rest(0, (0.0, 0.4, 0.0)) if isinstance(o, Stopped)]
    scripted.rest(0, (0.0, 0.4, 0.0), count=2)
    assert scripted.gate.step(Reset(again.id, "x"))[0].accepted
    scripted.q[0] = (0.0, 0.4, 0.0)
    scripted.rest(0, count=2)
    assert np.array_equal(space.motion[0], before)


def test_bounds_proven_inside_the_limits_do_not_hold_outside():
    """The room for a rotation counts the true length of a slide that was pushed out."""
    rig = Rig(scenes.lever(), stops=0.02, start=[np.array([0.0, 0.2, 0.0])])
    rig.feed(LinkChange("A", LinkState.READY))
    stop = push(rig, 0, (0.0, 1.1, 0.0))
    assert isinstance(rig.reset(stop)[1], Rebase)
    rig.outside[0] = 0.4
    rig.run(creep, 200)
    assert rig.tally.violations == []
    assert rig.tally.accepted > 0.1


def test_a_tick_of_a_link_that_keeps_its_own_setpoint_is_accepted():
    """The RSI link does this: the tick after a reset reports the position at which the robot is held."""
    scripted = pair()
    (x,) = scripted.q[0]
    scripted.command((STEP,))
    scripted.play()
    scripted.rest(0, (x,), count=3)
    (stop,) = scripted.gate.step(Stop(("left",), "x", "y"))
    assert scripted.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    scripted.tick[0] += 1
    now = scripted.tick[0] * T
    assert (
        scripted.gate.step(Tick("left", scripted.tick[0], now, (x,), scripted.q[0], (0.0,), rebased=True))
        == []
    )
    assert scripted.view().setpoint == scripted.q[0]
    scripted.rest(0, (x,))
    assert scripted.command((STEP,)).outcome is Outcome.ADMITTED
