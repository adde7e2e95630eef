"""Safety checks on states: safe motion gives no finding, each kind of unsafe motion gives one."""

import math
from dataclasses import replace

import pytest

from armgate.conformance.command_log import CommandLog
from armgate.conformance.safety_checks import JointBounds, Sample, is_at_rest, unsafe_motion

BOUNDS = JointBounds(lower=(-1.0,), upper=(1.0,), step=(0.1,), change=(0.05,), brake=(0.06,))


def samples(positions, applied=None, **more):
    """Return one state per tick; ``applied`` is by tick."""
    seq, found = None, []
    for tick, position in enumerate(positions):
        seq = (applied or {}).get(tick, seq)
        at = {key: values.get(tick, values.get("else")) for key, values in more.items()}
        found.append(
            Sample(
                tick, (position,), seq, at.get("holder", "me"), at.get("stops") or (), at.get("nearest") or ()
            )
        )
    return found


def commands(*verdicts):
    """Return a log of commands and their verdicts."""
    kept = CommandLog()
    for seq, outcome, target, setpoint in verdicts:
        kept.sent["R", seq] = {"seq": seq}
        if outcome is not None:
            kept.verdicts["R", seq] = {
                "seq": seq, "outcome": outcome, "target": target, "setpoint": [setpoint],
            }  # fmt: skip
    return kept


def found(seen, kept=None):
    return list(unsafe_motion("R", seen, BOUNDS, kept or commands()))


def test_motion_by_verdicts_and_braking_is_safe():
    kept = commands((1, "admitted", 2, 0.05), (2, "limited", 3, 0.14))
    seen = samples([0.0, 0.0, 0.05, 0.14, 0.18, 0.20, 0.20], {2: 1, 3: 2})
    assert found(seen, kept) == []
    assert is_at_rest(seen)
    assert not is_at_rest(seen[:-1])


@pytest.mark.parametrize(
    ("seen", "kept", "text"),
    [
        (samples([0.98, 0.99, 1.02]), None, "beyond its limits"),
        (samples([0.0, 0.3]), None, "its speed allows"),
        (samples([0.0, 0.0, 0.03]), None, "speeds up"),
        (samples([0.0, 0.04, 0.06, 0.05]), None, "speeds up"),
        (samples([0.0, 0.0, 0.03], stops={"else": (4,)}), None, "while stopped"),
        (samples([0.0, 0.0, 0.03], holder={"else": None}), None, "while no client holds it"),
        (samples([0.0, 0.0, 0.09], {2: 1}), commands((1, "admitted", 2, 0.09)), "accelerates"),
        (samples([0.0, 0.05, 0.14, 0.16], {1: 1, 2: 2}), None, "brakes"),
        (samples([0.0, 0.04, 0.0], {2: 1}), commands((1, "admitted", 2, 0.0)), "turns"),
        (samples([0.0, 0.0, 0.03], {2: 1}), None, "no client sent"),
        (samples([0.0, 0.0, 0.03], {2: 1}), commands((1, "refused", None, 0.0)), "which was refused"),
        (samples([0.0, 0.0, 0.03], {2: 1}), commands((1, "admitted", 3, 0.03)), "its verdict names 3"),
        (
            samples([0.0, 0.0, 0.03], {2: 1}),
            commands((1, "admitted", 2, 0.02)),
            "off that of the verdict of seq 1",
        ),
        (
            samples([0.0, 0.0, 0.03], {2: 1}, stops={"else": (4,)}),
            commands((1, "admitted", 2, 0.03)),
            "although the robot is stopped",
        ),
    ],
)
def test_each_unsafe_motion_is_found(seen, kept, text):
    assert any(text in finding for finding in found(seen, kept)), found(seen, kept)


def test_a_forbidden_command_is_found_whatever_its_verdict():
    kept = commands((1, "admitted", 2, 0.03))
    kept.forbid({"robot": "R", "seq": 1}, "its fence is old")
    assert any("its fence is old" in finding for finding in found(samples([0.0, 0.0, 0.03], {2: 1}), kept))


def test_a_missed_state_is_no_finding():
    seen = samples([0.0, 0.0, 0.05, 0.13, 0.2], {2: 1, 3: 2, 4: 3})
    kept = commands(*((seq, "admitted", None, 0.0) for seq in (1, 2, 3)))
    assert found([seen[0], seen[1], seen[4]], kept) == []


def test_a_joint_without_a_bound_may_stop_at_once():
    free = replace(BOUNDS, brake=(math.inf,))
    seen = samples([0.0, 0.05, 0.14, 0.14])
    assert not [f for f in unsafe_motion("R", seen, free, commands()) if "brakes" in f]


def test_a_reset_may_move_the_setpoint_to_the_measured_position():
    seen = samples([0.0, 0.0, 0.09, 0.09], stops={1: (4,)})
    assert not [f for f in found(seen) if "accelerates" in f]


def near(distance):
    return ((("a", "b"), distance, 0.05),)


def test_a_violated_clearance_is_found_unless_it_was_violated_before():
    assert found(samples([0.0, 0.0], nearest={0: near(0.06), 1: near(0.04)}))
    assert not found(samples([0.0, 0.0], nearest={0: near(0.03), 1: near(0.04)}))


def test_a_robot_outside_its_limits_may_move_back():
    assert found(samples([1.2, 1.17, 1.14])) == []
    assert found(samples([1.2, 1.23]))
