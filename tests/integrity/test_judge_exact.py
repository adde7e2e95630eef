"""How a wish is reduced where something is in the way: one budget, few trials, and every number told."""

import numpy as np
import pytest

from armgate.cell.events import Cause, Outcome
from armgate.integrity import judge as judging
from integrity import scenes
from integrity.hands import STEP, Hands
from integrity.rig import Rig


def lane_hands(x, response="stop", **cell):
    cell = scenes.lane(response=response, **cell)
    return Hands(cell, [(x, 0.0)])


def queries(hands):
    return hands.gate._clearance.certifier.queries


@pytest.mark.parametrize("response", ["stop", "slow"])
def test_all_trials_of_a_command_share_one_budget(response, monkeypatch):
    """An arm among wires at full speed: however many trials, never more questions than the budget."""
    cell = scenes.wire(response=response)
    rng = np.random.default_rng(1)
    rig = Rig(cell, stops=0.0)
    most, refused = 0, 0
    monkeypatch.setattr(judging, "BUDGET", 5)
    for k in range(250):
        before = queries(rig)
        robot = rig.cell.robots[0]
        if k % 30 == 0:
            u = robot.velocity * robot.period * rng.choice((-1.0, 1.0), 4)
        refused += rig.command(0, u).outcome is Outcome.REFUSED
        most = max(most, queries(rig) - before)
        for _ in range(rig.every[0]):
            rig.step()
    rig.check()
    assert rig.tally.violations == []
    assert refused > 0
    assert 1 < most <= 5 + 1  # and one for the witness points of a refusal


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_slow_takes_what_room_there_is(share):
    wish = 0.00057
    hands = lane_hands(0.4 - share * wish, "slow")
    verdict = hands.ask((wish, 0.0))
    assert verdict.outcome is Outcome.LIMITED
    assert 0.9 * share <= verdict.beta <= share
    assert verdict.dq == (pytest.approx(verdict.beta * wish), 0.0)
    assert [r.cause for r in verdict.reasons] == [Cause.CLEARANCE]
    assert verdict.reasons[0].value == pytest.approx(0.05 - (1.0 - share) * wish, abs=1e-6)
    again = lane_hands(0.4 - share * wish, "stop").ask((wish, 0.0))
    assert (again.outcome, again.beta, again.dq) == (Outcome.REFUSED, 0.0, (0.0, 0.0))


def test_what_both_bounds_and_clearance_take_is_multiplied():
    """The blend of the limits times that of clearance; the reasons in the order of the checks."""
    hands = lane_hands(0.4 - 0.0002, "slow")
    verdict = hands.ask((0.1, 0.0))
    assert [r.cause for r in verdict.reasons] == [Cause.INCREMENT, Cause.ACCELERATION, Cause.CLEARANCE]
    assert 0.0 < verdict.dq[0] < 0.0002
    assert verdict.beta == pytest.approx(verdict.dq[0] / (4 * 0.012**2))


def test_asking_for_less_than_the_braking_gives_the_braking():
    hands = Hands(scenes.head_on(1.1, (0.004, 0.004)))
    hands.ask((STEP,))
    hands.play()
    verdict = hands.ask((0.0,))
    assert verdict.outcome is Outcome.ADMITTED
    assert verdict.dq == (0.0,)


def test_a_refused_robot_brakes_on_along_its_plan():
    """Full speed at the wall: what is refused plays the rest of the plan, increment by increment."""
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


def test_a_joint_outside_may_not_stay_there_whatever_else_moves_in_slow_either():
    rig = Rig(scenes.lane(response="slow"), stops=0.0, start=[np.array([-1.0, 2.1])])
    verdict = rig.command(0, (-1e-4, 0.0))
    assert verdict.outcome is Outcome.REFUSED
    assert verdict.reasons[-1].joint == "J1"
    assert verdict.beta == 0.0


def test_one_proven_step_is_enough_for_the_next():
    """The kept bound less the step: far from the wall no engine is asked, and the bound falls by the way."""
    hands = lane_hands(-1.0)
    before = queries(hands)
    hands.ask((4 * 0.012**2 * 0.9, 0.0))
    assert queries(hands) == before
