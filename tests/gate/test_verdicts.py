"""Every reason has its numbers; those of clearance can be checked from the verdict alone."""

import random

import numpy as np
import pytest

from armgate.events import Cause, Outcome, Verdict
from gate import scenes
from gate.adversary import Adversary
from gate.oracle import Oracle
from gate.rig import ROUGH, Rig


@pytest.mark.daily(1)
@pytest.mark.parametrize(("scene", "response"), [("duel", "stop"), ("corner", "slow"), ("wire", "stop")])
def test_every_reason_of_an_attack_is_complete_and_true(scene, response):
    cell = scenes.SCENES[scene](response=response, **({"gap": 1.1} if scene == "duel" else {}))
    oracle = Oracle(cell)
    rig = Rig(cell, 5, 0.03, 0.0, ROUGH, oracle=oracle, stops=0.0)
    rig.run(Adversary(random.Random(2), ("greedy", "wild", "limits")), 700)
    verdicts = [o for out in rig.outputs for o in out if isinstance(o, Verdict)]
    names = [tuple(oracle.names[k] for k in pair) for pair in oracle.pairs]
    seen = set()
    for v in verdicts:
        assert (v.outcome is Outcome.ADMITTED) == (not v.reasons)
        for r in v.reasons:
            assert r.text
            seen.add(r.cause)
            if r.cause in (Cause.INCREMENT, Cause.ACCELERATION):
                assert None not in (r.joint, r.value, r.bound)
                assert r.value > r.bound or r.value < r.bound
            if r.cause is Cause.JOINT_LIMIT:
                assert r.joint in [j.name for j in cell.robots[cell.robot_index(v.robot)].model.joints]
                assert None not in (r.value, r.bound)
            if r.cause is Cause.CLEARANCE:
                limit = oracle.limits[names.index(r.pair)]
                assert r.bound == limit
                assert r.value < limit
                assert r.points is not None
                p, q = map(np.array, r.points)
                assert np.all(np.isfinite([p, q]))
                assert r.value <= np.linalg.norm(q - p) + 1e-6
    assert seen >= {Cause.INCREMENT, Cause.ACCELERATION, Cause.CLEARANCE}


@pytest.mark.parametrize("response", ["stop", "slow"])
def test_witness_points_lie_on_their_bodies_in_the_world(response):
    """A ball 0.4 mm from its limit: both points, the pair in its order, and the distance by hand."""
    rig = Rig(scenes.lane(response=response), stops=0.0, start=[np.array([0.3996, 0.25])])
    verdict = rig.command(0, (0.0057, 0.0))
    reason = verdict.reasons[-1]
    assert reason.pair == ("A/L1", "wall")
    on_ball, on_wall = map(np.array, reason.points)
    assert on_wall[0] == pytest.approx(0.5, abs=1e-6)
    assert on_wall[1:] == pytest.approx([0.25, 0.0], abs=1e-3)
    assert on_ball[1:] == pytest.approx([0.25, 0.0], abs=1e-3)
    assert 0.4496 - 1e-6 <= on_ball[0] <= 0.4514
    assert 0.0485 < reason.value < 0.05


def test_witness_points_are_reported_even_if_the_budget_is_used_up(monkeypatch):
    monkeypatch.setattr("armgate.gate.decision.BUDGET", 0)
    rig = Rig(scenes.lane(), stops=0.0, start=[np.array([0.3999, 0.0])])
    (reason,) = rig.command(0, (0.0005, 0.0)).reasons
    assert reason.points is not None
    assert reason.value < 0.05
