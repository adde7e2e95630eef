"""Retreats: several violations at once, joints outside, two robots one at a time in the configured order."""

import numpy as np
import pytest

from armgate.events import Cause, LeaseChange, LinkChange, LinkState, Outcome, Reset, Stopped
from gate import scenes
from gate.rig import Rig

AWAY = {"fast": np.array([0.0, -0.0005]), "slow": np.array([0.0, 0.0005])}


def near(first=(0.0, 0.0), second=(0.0, 0.11)):
    """Return two balls of 5 cm, 1 cm apart with 2 cm to be kept; ``fast`` is first in the configuration."""
    return Rig(scenes.crossing(window=0.0, periods=(0.012, 0.012)), stops=0.0,
               start=[np.array(first), np.array(second)])  # fmt: skip


def ask(rig, *order):
    rig.step()
    for _ in range(5):
        rig.step()  # one tick of both
    return [rig.command(i, (AWAY["fast"], AWAY["slow"])[i]) for i in order]


def test_of_two_robots_the_first_in_the_configuration_goes_first_in_any_order_of_commands():
    rig = near()
    ask(rig, 1)
    (early,) = ask(rig, 1)
    assert early.outcome is not Outcome.REFUSED  # no other robot is commanded
    (waiting,) = ask(rig, 0)
    assert waiting.outcome is Outcome.REFUSED  # the other robot is moving
    assert waiting.reasons[-1].cause is Cause.CLEARANCE
    (yielding,) = ask(rig, 1)
    assert yielding.outcome is Outcome.REFUSED  # the first robot in the configuration has the turn
    for _ in range(12):
        rig.step()
    first, second = ask(rig, 0, 1)
    assert first.outcome is not Outcome.REFUSED
    assert second.outcome is Outcome.REFUSED
    second, first = ask(rig, 1, 0)
    assert first.outcome is not Outcome.REFUSED
    assert second.outcome is Outcome.REFUSED


def test_both_robots_end_their_violation_and_then_move_at_the_same_time():
    rig = near()
    for _ in range(30):
        ask(rig, 1, 0)
    both = ask(rig, 1, 0)
    assert [v.outcome for v in both] == [Outcome.ADMITTED] * 2
    rig.check()
    assert rig.tally.violations == []


@pytest.mark.parametrize("why", ["rests", "no lease", "stopped", "no way out"])
def test_the_second_robot_moves_if_the_first_does_not(why):
    rig = near()
    assert ask(rig, 0)[0].outcome is not Outcome.REFUSED
    for _ in range(6):
        rig.step()
    if why == "rests":
        for _ in range(24):
            rig.step()
    if why == "no lease":
        rig.feed(LeaseChange("fast", None))
    if why == "stopped":
        rig.stop("fast")
    if why == "no way out":
        rig.step()
        assert rig.command(0, (0.0, 0.0005)).outcome is Outcome.REFUSED
    for _ in range(12):
        rig.step()
    assert ask(rig, 1)[0].outcome is not Outcome.REFUSED


def corner(distance=0.012):
    """Return a ball of 5 cm in a corner, too near to the floor and to both walls."""
    edge = 0.05 + distance + 0.1
    walls = {
        f"wall_{k}": {"shape": {"box": size}, "xyz": [edge * (k == j) for j in range(3)]}
        for k, size in enumerate(([0.2, 2, 2], [2, 0.2, 2], [2, 2, 0.2]))
    }
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0), (0, 0, 1)), "start": [0.0] * 3}
    return Rig(scenes.build({"A": robot}, surroundings=walls), stops=0.0)


@pytest.mark.parametrize(
    ("u", "way"),
    [
        ((-1, -1, -1), True),
        ((-1, 0, 0), True),
        ((-1, -1, 0.05), True),
        ((1, 1, 1), False),
        ((-1, -1, 1), False),
    ],
)
def test_no_violation_may_get_worse_and_one_must_get_better(u, way):
    rig = corner()
    verdict = rig.command(0, 5e-4 * np.array(u))
    assert (verdict.outcome is not Outcome.REFUSED) == way
    if not way:
        reason = verdict.reasons[-1]
        assert reason.cause is Cause.CLEARANCE
        assert reason.value == pytest.approx(0.012, abs=6e-4)
        assert reason.points is not None
    for _ in range(300):
        rig.step(lambda rig, i: (-1e-3, -1e-3, -1e-3))
    rig.check()
    assert rig.tally.violations == []
    assert rig.last_verdict[0].outcome is Outcome.ADMITTED


def test_a_floor_only_rises():
    """After some millimetres of retreat, the robot cannot return to the distance at which it began."""
    rig = corner()
    for _ in range(60):
        rig.step(lambda rig, i: (-2e-4, -2e-4, -2e-4))
    rig.rest()
    reached = max(rig.drives[0].q)
    assert reached < -2e-4
    for _ in range(200):
        rig.step(lambda rig, i: (1e-5, 1e-5, 1e-5))
    rig.rest()
    assert max(rig.drives[0].q) <= reached + 2e-4 + 1e-9


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_outside_its_limits_may_only_move_back(side):
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([-1.0, 2.1 * side])])
    rig.feed(LinkChange("A", LinkState.READY))
    out = rig.command(0, (-1e-4, 0.0))
    assert out.outcome is Outcome.REFUSED
    reason = out.reasons[-1]
    assert (reason.cause, reason.joint) == (Cause.JOINT_LIMIT, "J1")
    assert (reason.value, reason.bound) == (2.1 * side, 2.0 * side)
    rig.step()
    for _ in range(6):
        rig.step()
    assert rig.command(0, (0.0, -1e-4 * side)).outcome is Outcome.ADMITTED


@pytest.mark.parametrize(("silent", "waits"), [(0, True), (3, True), (4, False)])
def test_the_first_robot_keeps_its_turn_for_three_ticks_after_its_command(silent, waits):
    rig = near()
    ask(rig, 0)
    for _ in range(48):
        rig.step()
    rig.gate._decisions._retreat._turn[0] = rig.gate._robots[0].tick - silent
    verdict = rig.command(1, AWAY["slow"])
    assert (verdict.outcome is Outcome.REFUSED) == waits


@pytest.mark.parametrize(("down", "way"), [(1.5e-4, True), (2.5e-4, False)])
def test_a_violated_pair_may_lose_a_fifth_of_a_millimetre_while_another_widens(down, way):
    """Out along two walls and toward the third, up to its floor less 0.2 mm."""
    rig = corner()
    verdict = rig.command(0, (-5e-4, -5e-4, down))
    assert (verdict.outcome is not Outcome.REFUSED) == way


def test_the_slack_is_for_the_whole_retreat_and_not_per_command():
    """Many small steps toward the third wall end where one large step would end."""
    rig = corner()
    for _ in range(60):
        rig.step(lambda rig, i: (-2e-5, -2e-5, 2e-5))
    rig.rest()
    assert 0.0 < rig.drives[0].q[2] <= 2e-4 + 1e-9


def test_no_new_violation_is_allowed_during_a_retreat():
    """In the direction away from the near wall there is another wall, just at its stop distance."""
    walls = {
        "near": {"shape": {"box": [0.2, 2, 2]}, "xyz": [0.05 + 0.012 + 0.1, 0, 0]},
        "far": {"shape": {"box": [0.2, 2, 2]}, "xyz": [-(0.05 + 0.0203 + 0.1), 0, 0]},
    }
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0)), "start": [0.0] * 2}
    rig = Rig(scenes.build({"A": robot}, surroundings=walls), stops=0.0)
    assert rig.command(0, (-5e-4, 0.0)).outcome is Outcome.REFUSED
    rig.step()
    for _ in range(5):
        rig.step()
    assert rig.command(0, (-2e-4, 0.0)).outcome is not Outcome.REFUSED


def test_a_floor_is_removed_when_its_pair_is_clear():
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.42, 0.0])])
    floors = rig.gate._decisions._retreat._floor
    assert rig.command(0, (-1e-4, 0.0)).outcome is not Outcome.REFUSED
    assert list(floors) == [0]
    for _ in range(240):
        rig.step(lambda rig, i: (-1e-3, 0.0))
    assert rig.drives[0].q[0] < 0.4
    assert floors == {}


def test_a_retreat_begins_at_rest():
    """If a body appears in the path of a moving robot, the robot brakes first."""
    rig = corner()
    rig.command(0, (-5e-4, -5e-4, -5e-4))
    for _ in range(8):
        rig.step()
    retreat = rig.gate._decisions._retreat
    assert len(retreat._floor) == 3
    retreat._floor.clear()
    rig.gate._robots[0].last = (1e-3, 0.0, 0.0)
    assert rig.command(0, (-5e-4, -5e-4, -5e-4)).outcome is Outcome.REFUSED


@pytest.mark.parametrize(("out", "kept"), [(0.5e-4, 0.5e-4), (5e-4, 1e-4)])
def test_a_joint_outside_its_limits_may_lose_a_little_while_another_moves_back(out, kept):
    """At most 0.1 mrad in all, for any command."""
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([-2.1, 2.1])])
    verdict = rig.command(0, (5e-4, out))
    assert verdict.outcome is not Outcome.REFUSED
    assert verdict.dq == (5e-4, pytest.approx(kept, rel=1e-6))


def test_a_joint_that_is_back_inside_has_its_limit_again():
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([-1.0, 2.0003])])
    rig.command(0, (0.0, -5e-4))
    for _ in range(18):
        rig.step()
    assert rig.players[0].setpoint[1] < 2.0
    verdict = rig.command(0, (0.0, 5e-4))
    assert verdict.dq[1] == pytest.approx(2.0 - rig.players[0].setpoint[1])


# --- turns, exact to the tick and the micrometre ------------------------------------------------------------


@pytest.mark.parametrize("why", ["no lease", "stopped", "no way out"])
def test_the_robot_that_went_first_gives_way_at_once(why):
    """It does not keep its turn for three more ticks."""
    rig = near()
    rig.step()
    for _ in range(5):
        rig.step()
    claim, now = rig.gate._decisions._retreat._turn, rig.gate._robots[0].tick
    claim[0] = now
    assert rig.command(1, AWAY["slow"]).outcome is Outcome.REFUSED
    for _ in range(6):
        rig.step()
    claim[0] = now + 1
    if why == "no lease":
        rig.feed(LeaseChange("fast", None))
    if why == "stopped":
        rig.stop("fast")
    if why == "no way out":
        assert rig.command(0, (0.0, 0.0005)).outcome is Outcome.REFUSED
    assert rig.command(1, AWAY["slow"]).outcome is not Outcome.REFUSED


def test_a_robot_that_may_not_retreat_because_it_still_moves_does_not_go_first():
    rig = near()
    rig.step()
    for _ in range(5):
        rig.step()
    rig.gate._robots[0].last = (1e-3, 0.0)
    assert rig.command(0, AWAY["fast"]).outcome is Outcome.REFUSED
    rig.gate._robots[0].last = (0.0, 0.0)
    assert rig.command(1, AWAY["slow"]).outcome is not Outcome.REFUSED


@pytest.mark.parametrize(
    ("u", "way"),
    [((-1.5e-7, 0.0), True), ((-0.5e-7, 0.0), False), ((0.0, 1e-4), False), ((0.5e-7, 0.0), False)],
)
def test_a_retreat_widens_by_at_least_a_tenth_of_a_micrometre(u, way):
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.42, 0.0])])
    assert (rig.command(0, u).outcome is not Outcome.REFUSED) == way


def test_a_robot_found_too_near_again_after_it_was_clear_gets_a_new_floor():
    """The floor reached before no longer counts: the robot could never keep it at its present position."""
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.42, 0.0])])
    rig.expect_faults = True

    def back(rig, i):
        return (-1e-3, 0.0)

    for _ in range(240):
        rig.step(back)
    rig.rest()
    assert rig.drives[0].q[0] < 0.4
    rig.command(0, (-1e-4, 0.0))
    for _ in range(12):
        rig.step()
    rig.drives[0].q = np.array([0.43, 0.0])
    player = rig.players[0]
    (stopped,) = rig.feed(player.play(rig.now, [0.43, 0.0]))
    rig.feed(player.play(rig.now, [0.43, 0.0]))
    assert rig.reset(stopped.id)[0].accepted
    rig.feed(player.play(rig.now, [0.43, 0.0]))
    assert rig.command(0, (-1e-4, 0.0)).outcome is not Outcome.REFUSED


def test_a_pair_proven_by_cells_to_keep_exactly_its_limit_is_not_violated():
    """Cells prove the distance needed to the bit, and no more: the bound must not fall below it."""
    around = {"b": {"shape": {"sphere": 0.05}, "xyz": [-0.125, 0.125, 0.0]}}
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0)), "start": [-0.5, 0.0]}
    rig = Rig(scenes.build({"A": robot}, surroundings=around), stops=0.0)
    clearance, state = rig.gate._clearance, rig.gate._robots[0]
    bend = np.array([(-0.5, 0.0), (0.0, 0.0), (0.0, 0.5)])  # around the ball, 25 mm from it
    clearance.hold(0, [clearance.space.sweep_nodes(0, bend, np.zeros(2))])
    clearance.bound[0] = 0.019
    clearance.mark_maybe_below()
    assert clearance.below(0) == [0]
    demand = rig.gate._decisions._retreat.requirements(state, [state])
    assert clearance.bound[0] == clearance.limits[0] == 0.02
    assert (demand.violated, demand.forbidden) == ((), None)
    assert demand.need.tolist() == [0.02]


@pytest.mark.parametrize("window", [0.0, 0.024])
def test_the_first_floor_after_a_fault_is_that_of_the_position_where_the_robot_was_found(window):
    """The robot is pushed 3 mm out of a violation of 1 cm; its old setpoint still counts after the reset."""
    cell = scenes.crossing(window=window, periods=(0.012, 0.012))
    rig = Rig(cell, stops=0.0, start=[np.array((0.0, 0.0)), np.array((0.0, 0.11))])
    rig.expect_faults = True
    rig.drives[0].push(np.array((0.0, -0.003)))
    stop = next(one for one in rig.held(0) if isinstance(one, Stopped))
    for _ in range(3):
        rig.held(0)
    for met in (one for one in rig.stopped if one is not stop):
        rig.feed(Reset(met.id, "rig"))
    assert rig.feed(Reset(stop.id, "rig"))[0].accepted
    floors, at_once = rig.gate._decisions._retreat._floor, rig.command(0, AWAY["fast"])
    assert at_once.outcome is Outcome.REFUSED
    for _ in range(4):
        rig.held(0)
    assert rig.command(0, AWAY["fast"]).outcome is not Outcome.REFUSED
    assert floors[0] == pytest.approx(0.013, abs=1e-6)
