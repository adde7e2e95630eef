"""Resets: at rest under noise, at joint limits, with a plan under way, after a push by hand."""

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
    """Ticks at which a robot that stands is measured off by so much."""
    for _ in range(count):
        q = rig.drives[i].q + np.array(off)
        assert rig.feed(rig.players[i].play(rig.now, [float(x) for x in q])) == []


def toward(rig, sign):
    """The first joint at full speed until it has come as near as it may; then rest."""
    for _ in range(1200):
        rig.step(lambda rig, i: (sign * 0.01, 0.0))
    rig.rest()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_resets_under_noise_never_lead_nearer_than_the_stop_distance(tolerance, side):
    """At the wall, measured nearer by the tolerance each time: the setpoint must not follow the noise."""
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
def test_resets_under_noise_lead_no_setpoint_out_of_its_limits(side):
    cell = scenes.boom(1e-3, surroundings={})
    rig = Rig(cell, stops=0.0, start=[np.array([1.2 * side, 0.0])])
    for _ in range(40):
        stop = rig.stop("A")
        measured_off(rig, 0, (side * 1e-3, 0.0))
        _, rebase = rig.reset(stop)
        assert rebase.setpoint == (1.2 * side, 0.0)
        rig.rest()


def test_where_a_robot_stands_off_its_setpoint_all_is_proven_anew():
    """It stands a step short of its setpoint, and is reset there."""
    hands = pair(1.0)
    (x,) = hands.q[0]
    hands.ask((STEP,))
    hands.play()
    hands.rest(0, (x,), count=3)
    kept = hands.kept()
    hands.gate._clearance.bound.lower(0, np.array([0.5 * kept]))  # as if less had been proven on the way
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    answer, rebase = hands.gate.step(Reset(stop.id, "x"))
    assert (answer.accepted, rebase.setpoint) == (True, (x,))
    proven = []
    judge = hands.gate._clearance.check
    hands.gate._clearance.check = lambda *given: proven.append(given) or judge(*given)
    assert hands.kept() == pytest.approx(kept, abs=1e-8)
    hands.q[0] = (x,)
    hands.rest(0, count=2)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert proven == []  # it stands at its setpoint: there is nothing to prove


def test_a_setpoint_stays_if_nothing_can_be_proven_of_the_other_one(monkeypatch):
    hands = pair()
    (x,) = hands.q[0]
    hands.ask((STEP,))
    hands.play()
    hands.rest(0, (x,), count=3)
    bounds = hands.kept()
    clearance = hands.gate._clearance
    monkeypatch.setattr(clearance.screen, "run", lambda *given: (np.array([-1.0]), np.array([0])))
    monkeypatch.setattr(clearance, "_prove", lambda *given: type("F", (), {"lb": -1.0, "points": None}))
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    answer, rebase = hands.gate.step(Reset(stop.id, "x"))
    assert (answer.accepted, rebase.setpoint, rebase.resets) == (True, hands.q[0], 1)
    assert hands.kept() == bounds


def test_a_setpoint_may_be_as_near_as_the_robot_is_where_that_is_too_near():
    """A retreat that the robot does not follow: where it stands, no more is proven than was."""
    hands = pair(0.015)
    (x,) = hands.q[0]
    assert hands.ask((-STEP,)).outcome is Outcome.ADMITTED
    hands.play()
    hands.rest(0, (x,), count=3)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert hands.kept() == pytest.approx(0.015, abs=1e-8)


def test_what_waits_for_its_answer_is_no_better_than_what_a_reset_proved():
    hands = pair()
    (x,) = hands.q[0]
    hands.ask((STEP,))
    hands.play()
    hands.rest(0, (x,), count=3)
    hands.ask((-STEP,), i=1, answer=None)
    staged = hands.gate._reservations._staged[1]
    staged += 0.01
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    assert staged.min() <= hands.kept()


# --- rest -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4, 1e-3])
def test_a_robot_that_stands_under_noise_is_reset(tolerance):
    rig = Rig(scenes.boom(tolerance), stops=0.0)
    for k in range(200):
        stop = rig.stop("A")
        measured_off(rig, 0, tolerance * np.array([(-1.0) ** k, 1.0 - k % 3]))
        assert rig.reset(stop)[0].accepted


@pytest.mark.parametrize("late", [0, 1, 5, 20])
def test_a_robot_under_way_is_not_reset(late):
    """Lagging by 0.12 s behind 1 rad/s it is far from its setpoint, whatever the noise."""
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
def test_a_robot_with_a_plan_under_way_is_not_reset(answered):
    """A link may take the plan at any time, and then it plays what the gate has forgotten."""
    hands = pair()
    hands.ask((STEP,), answer=answered)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x")) == [ResetAnswer(stop.id, False, "moving")]
    hands.gate.step(PlanAnswer("left", hands.held[0].key, True))
    assert hands.play() == []
    hands.rest(0)
    assert hands.gate.step(Reset(stop.id, "x"))[0] == ResetAnswer(stop.id, True)


# --- pushed by hand ---------------------------------------------------------------------------------------


def push(rig, i, q):
    """Another hand moves a robot; it is measured there until it rests. Returns the stop of its fault."""
    rig.expect_faults = True
    drive, player = rig.drives[i], rig.players[i]
    drive.q = np.array(q, dtype=float)
    (stopped,) = [o for o in rig.feed(player.play(rig.now, [float(x) for x in q])) if isinstance(o, Stopped)]
    for _ in range(200):
        rig.feed(player.play(rig.now, [float(x) for x in q]))
    return stopped.id


@pytest.mark.parametrize("deeper", [0.46, 0.4999, 0.52])
def test_a_robot_pushed_deeper_after_a_retreat_may_come_out_again(deeper):
    """A cart with a ball of 5 cm before a wall at 0.5 m, 5 cm to be kept; once it had come out to 0.42."""
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


def test_only_a_fault_clears_what_a_retreat_had_reached():
    """Stopped and reset again and again, a controller does not get in by the slack each time."""
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
def test_a_joint_pushed_out_of_its_limits_only_comes_back(side):
    rig = Rig(scenes.lane(), stops=0.0)
    stop = push(rig, 0, (-1.0, 2.1 * side))
    _, rebase = rig.reset(stop)
    assert rebase.setpoint == (-1.0, 2.1 * side)
    rig.feed(rig.players[0].play(rig.now, (-1.0, 2.1 * side)))
    verdict = rig.command(0, (-1e-4, 0.0))
    assert (verdict.outcome, verdict.reasons[-1].cause) == (Outcome.REFUSED, Cause.JOINT_LIMIT)
    rig.feed(rig.players[0].play(rig.now, (-1.0, 2.1 * side)))
    assert rig.command(0, (0.0, -1e-4 * side)).outcome is Outcome.ADMITTED


# --- outside of the range for which motion bounds were computed -------------------------------------------


def creep(rig, i):
    """The turning joint at full speed, the slide back by next to nothing."""
    return (0.03, -1e-6, 0.0)


@pytest.mark.parametrize("turned", [-1.8, -0.6, 0.0, 1.1])
@pytest.mark.parametrize("beyond", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("configured", [True, False])
def test_motion_bounds_hold_for_a_slide_that_is_found_beyond_its_limit(beyond, turned, configured):
    cell = scenes.lever(0.8 + beyond) if configured else scenes.lever()
    rig = Rig(cell, stops=0.02, start=[np.array([turned, 0.8 + beyond, 0.0])])
    rig.run(creep, 150)
    assert rig.tally.violations == []
    assert rig.tally.accepted > 0.1


@pytest.mark.parametrize("compiled", [True, False])
def test_motion_bounds_are_widened_for_a_robot_pushed_out_and_narrowed_once_it_is_back(compiled):
    if compiled:
        pytest.importorskip("numba")
    from armgate.gate import Gate

    hands = ScriptedGate(scenes.lever(), gate=Gate(scenes.lever(), "s", compiled))
    space, before = hands.gate._clearance.space, hands.gate._clearance.space.motion[0]
    pairs = hands.gate._clearance.screen.pairs[0]
    (stop,) = [o for o in hands.rest(0, (0.0, 1.3, 0.0)) if isinstance(o, Stopped)]
    wide = space.motion[0]
    assert (wide >= before).all()
    assert wide[-1, 0] >= before[-1, 0] + 0.4
    assert (hands.gate._clearance.screen.pairs[0].growth >= pairs.growth).all()
    assert hands.gate._clearance.screen.pairs[0].growth[:, 0].max() >= pairs.growth[:, 0].max() + 0.4
    assert hands.gate._robots[0].main.swept.motion is wide
    hands.rest(0, (0.0, 1.31, 0.0), count=2)
    assert space.motion[0] is wide  # there is room for some more
    _, rebase = hands.gate.step(Reset(stop.id, "x"))
    hands.q[0] = rebase.setpoint
    hands.rest(0)
    (again,) = [o for o in hands.rest(0, (0.0, 0.4, 0.0)) if isinstance(o, Stopped)]
    hands.rest(0, (0.0, 0.4, 0.0), count=2)
    assert hands.gate.step(Reset(again.id, "x"))[0].accepted
    hands.q[0] = (0.0, 0.4, 0.0)
    hands.rest(0, count=2)
    assert np.array_equal(space.motion[0], before)


def test_what_was_proven_inside_is_not_believed_outside():
    """A slide that was pushed out needs, turning, the room that it really needs."""
    rig = Rig(scenes.lever(), stops=0.02, start=[np.array([0.0, 0.2, 0.0])])
    rig.feed(LinkChange("A", LinkState.READY))
    stop = push(rig, 0, (0.0, 1.1, 0.0))
    assert isinstance(rig.reset(stop)[1], Rebase)
    rig.outside[0] = 0.4
    rig.run(creep, 200)
    assert rig.tally.violations == []
    assert rig.tally.accepted > 0.1


def test_a_tick_of_a_link_that_keeps_its_own_setpoint_is_taken():
    """As the RSI link does: the tick after a reset says where the robot is held."""
    hands = pair()
    (x,) = hands.q[0]
    hands.ask((STEP,))
    hands.play()
    hands.rest(0, (x,), count=3)
    (stop,) = hands.gate.step(Stop(("left",), "x", "y"))
    assert hands.gate.step(Reset(stop.id, "x"))[1].setpoint == (x,)
    hands.tick[0] += 1
    now = hands.tick[0] * T
    assert hands.gate.step(Tick("left", hands.tick[0], now, (x,), hands.q[0], (0.0,), rebased=True)) == []
    assert hands.view().setpoint == hands.q[0]
    hands.rest(0, (x,))
    assert hands.ask((STEP,)).outcome is Outcome.ADMITTED
