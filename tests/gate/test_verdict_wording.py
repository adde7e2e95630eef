"""Wording of verdicts: every reason has a text in full, and every cause a meaning."""

import math

import pytest

from armgate.events import Cause
from armgate.gate import verdict_wording as wording
from armgate.gate.step_bounds import StepBounds
from gate import scenes

BOUNDS = StepBounds(
    names=("J0", "J1"),
    lower=(-1.0, 0.0),
    upper=(1.0, 0.5),
    speed=(0.1, 0.01),
    accel=(1.0, 1.0),
    decel=(1.0, 1.0),
    kinds=("revolute", "prismatic"),
)
POINTS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0123))


@pytest.mark.parametrize(
    ("reason", "cause", "text"),
    [
        (wording.no_lease("A", []), Cause.LEASE, "no client has the lease of A: acquire it first"),
        (
            wording.no_lease("A", [3, 7]),
            Cause.LEASE,
            "A is stopped (stop 7, 3) and no client has its lease: "
            "an operator must reset the stop; then acquire the robot",
        ),
        (
            wording.wrong_fence("A", 2, 5),
            Cause.FENCE,
            "fence 2 is not that of the lease in force: acquire A",
        ),
        (
            wording.not_the_holder("A", 2),
            Cause.FENCE,
            "fence 2 is not that of a lease of this client: acquire A",
        ),
        (
            wording.stopped("A", [3]),
            Cause.STOPPED,
            "A is stopped (stop 3): an operator must reset it",
        ),
        (
            wording.link_not_ready("A", "waiting"),
            Cause.LINK,
            "the link to A is waiting: wait until it is ready",
        ),
        (
            wording.positions_unknown(["A", "B"]),
            Cause.LINK,
            "the position of A, B is not known yet: wait for its link",
        ),
        (wording.ahead("A", 9, 4), Cause.AHEAD, "based on tick 9, but A is at tick 4"),
        (wording.stale(4, 5, 3), Cause.STALE, "based on tick 4, 5 ticks ago; max_age_ticks allows 3"),
        (
            wording.tick_taken("A", 5),
            Cause.OCCUPIED,
            "tick 5 of A has a command already: one per tick",
        ),
        (wording.wrong_length("A", 3, 2), Cause.LENGTH, "dq has 3 values: A has 2 joints"),
        (
            wording.not_finite("J0", math.inf),
            Cause.NOT_FINITE,
            "dq of J0 is inf: send a finite number",
        ),
        (
            wording.clamped(Cause.INCREMENT, BOUNDS, 0, math.pi, math.pi / 2),
            Cause.INCREMENT,
            "J0: the speed bound allows 90 deg this tick, but 180 deg was requested",
        ),
        (
            wording.clamped(Cause.ACCELERATION, BOUNDS, 1, 0.002, 0.001),
            Cause.ACCELERATION,
            "J1: the acceleration bound allows 1 mm this tick, but 2 mm was requested",
        ),
        (
            wording.clamped(Cause.JOINT_LIMIT, BOUNDS, 1, -0.002, -0.0),
            Cause.JOINT_LIMIT,
            "J1: the joint limit with braking allows 0 mm this tick, but -2 mm was requested",
        ),
        (
            wording.common_stop(BOUNDS, 1, 0.4, 0.5),
            Cause.JOINT_LIMIT,
            "J1: the stop of all joints together would pass its limit 500 mm",
        ),
        (
            wording.outside_limit(BOUNDS, 1, 0.6, 0.5),
            Cause.JOINT_LIMIT,
            "J1 is outside its limit 500 mm: only motion back inside is allowed",
        ),
        (
            wording.too_near(("A/L1", "post"), 0.01234, 0.02, POINTS),
            Cause.CLEARANCE,
            "A/L1 and post: 12.3 mm could be proven on the way to rest, 20.0 mm must be kept",
        ),
        (
            wording.too_near(("A/L1", "post"), -math.inf, 0.02, None),
            Cause.CLEARANCE,
            "A/L1 and post: no distance could be proven on the way to rest, 20.0 mm must be kept",
        ),
    ],
)
def test_each_reason_has_its_cause_and_its_text(reason, cause, text):
    assert (reason.cause, reason.text) == (cause, text)


@pytest.mark.parametrize(
    ("reason", "joint", "value", "bound"),
    [
        (wording.wrong_fence("A", 2, 5), None, 2.0, 5.0),
        (wording.not_the_holder("A", 2), None, 2.0, None),
        (wording.ahead("A", 9, 4), None, 9.0, 4.0),
        (wording.stale(4, 5, 3), None, 5.0, 3.0),
        (wording.wrong_length("A", 3, 2), None, 3.0, 2.0),
        (wording.not_finite("J0", math.inf), "J0", None, None),
        (wording.clamped(Cause.INCREMENT, BOUNDS, 0, 0.2, 0.1), "J0", 0.2, 0.1),
        (wording.common_stop(BOUNDS, 1, 0.4, 0.5), "J1", 0.4, 0.5),
        (wording.outside_limit(BOUNDS, 1, 0.6, 0.5), "J1", 0.6, 0.5),
        (wording.too_near(("a", "b"), 0.01, 0.02, None), None, 0.01, 0.02),
        (wording.too_near(("a", "b"), -math.inf, 0.02, None), None, None, 0.02),
    ],
)
def test_reasons_with_numbers_have_value_and_bound(reason, joint, value, bound):
    assert (reason.joint, reason.value, reason.bound) == (joint, value, bound)


def test_every_cause_has_a_meaning_of_one_sentence():
    assert set(wording.MEANINGS) == set(Cause)
    assert all(text[0].isupper() and text.endswith(".") for text in wording.MEANINGS.values())


def test_bounds_per_tick_are_those_of_the_robot_times_powers_of_its_period():
    robot = scenes.lever().robots[0]
    bounds, T = StepBounds.of(robot), robot.period
    assert bounds.names == ("J0", "J1", "J2")
    assert bounds.kinds == ("revolute", "prismatic", "revolute")
    assert (bounds.lower, bounds.upper) == (tuple(robot.lower), tuple(robot.upper))
    assert bounds.speed == tuple(robot.velocity * T)
    assert bounds.accel == tuple(robot.acceleration * T * T)
    assert bounds.decel == tuple(robot.deceleration * T * T)
