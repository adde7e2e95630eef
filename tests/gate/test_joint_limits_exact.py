"""Joint limits to the last bit: an increment at its bound is admitted, one just above it gets a reason."""

import math

import pytest

from armgate.events import Cause
from armgate.gate.braking import largest_stoppable_increment, stop_increments, stop_share, ticks_to_rest
from armgate.gate.joint_limits import (
    ROUNDING,
    StepBounds,
    acceleration_box,
    blend,
    first_outside,
    limit_increment,
)

FREE = (math.inf,)


def bounds(speed=1.0, accel=1.0, decel=1.0, lower=-1.0, upper=1.0, joints=1):
    rows = ((x,) * joints for x in (lower, upper, speed, accel, decel))
    return StepBounds(tuple(f"J{k}" for k in range(joints)), *rows)


STILL = bounds(decel=math.inf)


@pytest.mark.parametrize(
    ("u", "q", "joint"),
    [
        (0.5, 0.5, None),
        (0.5 + 1e-11, 0.5, 0),
        (ROUNDING, 1.0, None),
        (1.5 * ROUNDING, 1.0, 0),
        (-0.5, -0.5, None),
        (-0.5 - 1e-11, -0.5, 0),
        (-ROUNDING, -1.0, None),
        (-1.5 * ROUNDING, -1.0, 0),
        (0.0, 1.5, None),  # already outside, and not moving
        (0.0, -1.5, None),
        (0.1, -1.5, None),  # moving back
        (-0.1, 1.5, None),
        (0.1, 1.5, 0),
        (-0.1, -1.5, 0),
    ],
)
def test_a_stop_may_end_at_a_limit_but_not_beyond(u, q, joint):
    assert first_outside((u,), (q,), STILL) == joint


def test_the_first_joint_that_leaves_its_limits_is_named():
    assert first_outside((0.0, 0.5, 0.5), (0.0, 0.9, 0.9), bounds(joints=3)) == 1


def test_the_ends_of_a_blend_are_exact():
    assert blend((1e16,), (1.0,), 1.0) == (1.0,)
    assert blend((1e16,), (1.0,), 0.0) == (1e16,)
    assert blend((1.0,), (3.0,), 0.5) == (2.0,)


@pytest.mark.parametrize(
    ("last", "box"),
    [(0.0, (-0.3, 0.3)), (0.1, (-0.15, 0.4)), (0.2, (0.0, 0.5)), (0.5, (0.3, 0.8)), (-0.1, (-0.4, 0.15))],
)
def test_an_acceleration_box(last, box):
    """The joint gains 0.3 away from zero, loses 0.2 toward it, and past zero uses the rest of the tick."""
    assert acceleration_box(last, 0.3, 0.2) == pytest.approx(box, abs=1e-15)


@pytest.mark.parametrize("decel", [0.2, 0.3, 0.7, math.inf])
@pytest.mark.parametrize("last", [0.0, -0.0, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.57, -0.57])
def test_increments_are_free_up_to_both_ends_of_the_acceleration_box_and_not_beyond(last, decel):
    b = bounds(speed=math.inf, accel=0.3, decel=decel, lower=-math.inf, upper=math.inf)
    low, high = acceleration_box(last, 0.3, decel)
    for dq, allowed in [
        (low, low),
        (high, high),
        (math.nextafter(low, -math.inf), low),
        (math.nextafter(high, math.inf), high),
    ]:
        assert limit_increment((dq,), (last,), (0.0,), (0.0,), b, 1.0).u == (allowed,)


def test_a_reason_has_the_joint_the_requested_increment_and_the_bound():
    shaped = limit_increment((-1.0,), (0.2,), (0.1,), (0.0,), bounds(speed=0.5, accel=0.3, decel=0.1), 1.0)
    speed, accel = shaped.reasons
    assert (speed.cause, speed.joint, speed.value, speed.bound) == (Cause.INCREMENT, "J0", -1.0, -0.5)
    assert (accel.cause, accel.value) == (Cause.ACCELERATION, -0.5)
    assert accel.bound == pytest.approx(0.1)
    assert shaped.u == pytest.approx((0.1,))
    (up,) = limit_increment((1.0,), (0.0,), (0.0,), (0.0,), bounds(speed=0.5, accel=1.0), 0.5).reasons
    assert (up.value, up.bound) == (1.0, 0.25)


@pytest.mark.parametrize(("dq", "named"), [(ROUNDING, False), (2 * ROUNDING, True)])
def test_rounding_is_not_reported(dq, named):
    shaped = limit_increment((dq,), (0.0,), (0.0,), (0.0,), bounds(speed=0.0), 1.0)
    assert (shaped.u, bool(shaped.reasons)) == ((0.0,), named)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("q", [0.0, 0.9, 0.99, 1.0, 1.5])
def test_a_joint_alone_uses_all_the_room_that_its_stop_leaves(q, sign):
    shaped = limit_increment((sign,), (0.0,), (0.0,), (sign * q,), bounds(decel=0.02), 1.0)
    assert shaped.u[0] == pytest.approx(sign * largest_stoppable_increment(max(1.0 - q, 0.0), 0.02), abs=1e-9)
    assert {r.cause for r in shaped.reasons} == {Cause.JOINT_LIMIT}
    assert (shaped.reasons[0].joint, shaped.reasons[0].value) == ("J0", sign)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_share_the_longest_stop_and_the_free_joint_keeps_its_increment(sign):
    """The second joint brakes longer than the first would alone, so the first gets less."""
    b = bounds(decel=0.02, joints=2)
    shaped = limit_increment((sign, 0.3), (0.0, 0.0), (0.0, 0.0), (0.95 * sign, 0.0), b, 1.0)
    reach = 1.0 + stop_share(ticks_to_rest(shaped.u, b.decel))
    assert shaped.u[1] == 0.3 or first_outside((0.0, 0.3), (0.0, 0.0), b) is not None
    assert shaped.u[0] * sign == pytest.approx(0.05 / reach, rel=1e-6)


def test_an_increment_that_braking_cannot_contain_is_blended_toward_the_held_path():
    """A joint that cannot lose its speed in one tick keeps the increment of the held path."""
    b = bounds(accel=0.05, decel=0.05, joints=2)
    last, brake, q = (0.2, 0.0), (0.15, 0.0), (0.7, 0.0)  # 0.15 + 0.1 + 0.05 ends at the limit
    shaped = limit_increment((0.2, 0.05), last, brake, q, b, 1.0)
    assert first_outside(shaped.u, q, b) is None
    assert shaped.u[0] == pytest.approx(0.15)
    assert 0.0 <= shaped.beta <= 1.0
    steep = limit_increment((0.2, 0.05), (0.2, 0.05), (0.15, 0.0375), (0.7, 0.0), b, 1.0)
    assert first_outside(steep.u, (0.7, 0.0), b) is None


def test_each_binding_limit_is_a_reason_in_the_order_of_the_checks():
    limited = limit_increment((5.0,), (0.0,), (0.0,), (0.95,), bounds(speed=0.5, decel=math.inf), 1.0)
    assert limited.u == pytest.approx((0.05,))
    assert [reason.cause for reason in limited.reasons] == [Cause.INCREMENT, Cause.JOINT_LIMIT]


def test_a_blend_toward_a_lower_limit_names_that_limit():
    b = StepBounds(("a", "b"), (-1.0,) * 2, (1.5,) * 2, (1.0,) * 2, (1.0, 1.0), (0.01, 0.01))
    last = (0.0, -0.1)
    limited = limit_increment((-0.15, -0.2), last, stop_increments(last, b.decel)[1], (0.0, -0.55), b, 1.0)
    reason = limited.reasons[-1]
    assert (reason.joint, reason.value, reason.bound) == ("b", -0.55, -1.0)
    assert "-1" in reason.text


def test_a_blend_names_the_joint_its_setpoint_and_its_limit():
    b = StepBounds(("a", "b"), (-1.0,) * 2, (1.0,) * 2, (1.0,) * 2, (1.0, 1.0), (0.01, 0.01))
    last = (0.0, 0.1)
    brake = stop_increments(last, b.decel)[1]
    shaped = limit_increment((0.15, 0.2), last, brake, (0.0, 0.55), b, 1.0)
    assert 0.0 < shaped.beta < 1.0
    reason = shaped.reasons[-1]
    assert (reason.cause, reason.joint, reason.value, reason.bound) == (Cause.JOINT_LIMIT, "b", 0.55, 1.0)
    assert first_outside(shaped.u, (0.0, 0.55), b) is None
    wanted = (
        largest_stoppable_increment(1.0, 0.01),
        0.09,
    )  # the first joint's stop is longer, and the second shares it
    assert shaped.u == pytest.approx(blend(brake, wanted, shaped.beta))
    assert first_outside(blend(brake, wanted, shaped.beta + 1e-6), (0.0, 0.55), b) == 1


# --- braking ------------------------------------------------------------------------------------------------


def test_braking_increments_by_hand():
    assert ticks_to_rest((0.1, -0.3), (0.1, 0.1)) == pytest.approx(3.0)
    assert ticks_to_rest((), ()) == 0.0
    assert stop_share(0.5) == 0.0
    assert stop_share(1.0) == 0.0
    assert stop_share(2.5) == pytest.approx(2 - 6 / 5)
    steps = stop_increments((0.3,), (0.1,))
    assert [u for (u,) in steps] == pytest.approx([0.3, 0.2, 0.1])
    assert stop_increments((0.1,), (0.1,)) == ((0.1,),)  # m = 1: nothing remains after it, not even zeros
    assert largest_stoppable_increment(0.5, math.inf) == 0.5
    assert largest_stoppable_increment(0.6, 0.1) == pytest.approx(0.3)
    assert largest_stoppable_increment(0.0, 0.1) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("q", [0.25, -0.25])
def test_a_joint_that_shares_a_stop_gets_the_room_that_the_stop_leaves(sign, q):
    """b's stop is five times as long, so a gets a sixth of its room; b keeps its whole increment."""
    b = StepBounds(("a", "b"), (q - 0.06, -9.0), (q + 0.06, 9.0), (1.0,) * 2, (9.0,) * 2, (0.5, 0.02))
    wide = 0.22
    reach = 1.0 + stop_share(wide / 0.02)
    shaped = limit_increment((0.06 * sign, wide), (0.0, 0.0), (0.0, 0.0), (q, 0.0), b, 1.0)
    assert shaped.u == (pytest.approx(0.06 * sign / reach, rel=1e-12), wide)
    assert shaped.beta == 1.0
    assert [r.joint for r in shaped.reasons] == ["a"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_beyond_its_limit_may_not_move_farther_out(sign):
    b = StepBounds(("a", "b"), (-1.0, -9.0), (1.0, 9.0), (1.0,) * 2, (9.0,) * 2, (0.5, 0.02))
    shaped = limit_increment((0.06 * sign, 0.22), (0.0, 0.0), (0.0, 0.0), (1.2 * sign, 0.0), b, 1.0)
    assert shaped.u == (0.0, 0.22)


@pytest.mark.parametrize(
    ("kind", "value", "text"),
    [
        ("revolute", math.pi / 180, "1 deg"),
        ("revolute", 1.38778e-17, "0 deg"),
        ("revolute", -1e-18, "0 deg"),
        ("prismatic", -5.12e-05, "-0.0512 mm"),
        ("prismatic", -0.0, "0 mm"),
        ("prismatic", 0.0123456789, "12.3457 mm"),
        (None, 0.25, "0.25"),
    ],
)
def test_reasons_have_units_and_are_rounded_without_minus_zero(kind, value, text):
    b = StepBounds(("a",), (-1.0,), (1.0,), (1.0,), (1.0,), (1.0,), (kind,) if kind else ())
    assert b.amount(0, value) == text


def test_reasons_of_prismatic_joints_are_in_millimetres():
    b = StepBounds(("slide",), (0.0,), (0.04,), (0.0016,), (1.0,), (1.0,), ("prismatic",))
    found = limit_increment((-5.12e-05,), (0.0,), (0.0,), (0.0,), b, 1.0)
    assert [reason.text for reason in found.reasons] == [
        "slide: the joint limit with braking allows 0 mm this tick, but -0.0512 mm was requested"
    ]


@pytest.mark.parametrize("dq", [0.0, 5.0, -5.0, math.inf])
@pytest.mark.parametrize("last", [3.0, -3.0, 1.5])
@pytest.mark.parametrize("upper", [100.0, 1.2])
def test_no_increment_exceeds_the_speed_bound_after_any_last_increment(dq, last, upper):
    wanted = limit_increment(
        (dq,), (last,), (0.0,), (0.0,), bounds(accel=0.3, decel=0.2, lower=-upper, upper=upper), 1.0
    )
    assert abs(wanted.u[0]) <= 1.0
