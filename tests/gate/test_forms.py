"""The compiled gate and the numpy gate give the same answers: random sessions, replayed in the other form.

``FORMS_SESSIONS=200`` makes it long.
"""

import os
import random

import pytest

from armgate.events import Outcome, Plan, Stopped, Verdict
from armgate.gate import Gate
from gate import adversary, scenes
from gate.oracle import Oracle
from gate.rig import HARSH, ROUGH, Rig

SESSIONS = int(os.environ.get("FORMS_SESSIONS", "3"))
SCENES = ("corner", "duel", "wire", "tree", "mesh")


def session(cell, seed):
    """Return events and outputs of a compiled gate driven by an adversary, without checks by the oracle."""
    rig = Rig(cell, seed, lag=0.03, oracle=Oracle(cell), stops=0.0, traffic=HARSH if seed % 2 else ROUGH)
    rig.check = rig._track.clear
    rig.run(adversary.Adversary(random.Random(seed)), 100)
    return rig


@pytest.mark.daily(2)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("response", ["slow", "stop"])
def test_both_forms_return_the_same_outputs_for_every_event(scene, response):
    """Verdicts with their reasons, numbers and points, plans and stops are equal to the last bit."""
    cell = scenes.SCENES[scene](response=response)
    bound = 0
    for seed in range(SESSIONS):
        given = scenes.lagging(cell, 0.03, 0.1) if seed % 3 == 2 else cell
        rig, other = session(given, seed), Gate(given, "rig", compiled=False)
        for event, answers in zip(rig.events, rig.outputs, strict=True):
            assert other.step(event) == answers
            for one in answers:
                assert isinstance(one, Verdict | Plan | Stopped)
                bound += isinstance(one, Verdict) and one.outcome is not Outcome.ADMITTED
    assert bound > 20 * SESSIONS
