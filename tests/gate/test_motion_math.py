"""Braking, bounds per tick and occupancy: pure arithmetic against brute force and samples."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from armgate.gate.braking import largest_stoppable_increment, stop_increments, stop_share, ticks_to_rest
from armgate.gate.joint_limits import StepBounds, acceleration_box, first_outside, limit_increment
from armgate.gate.occupancy import deviation, occupancy, settle_measured

small = st.floats(-1.0, 1.0, allow_nan=False)
decels = st.one_of(st.floats(1e-2, 0.5), st.just(math.inf))


@st.composite
def moves(draw):
    k = draw(st.integers(1, 7))
    return tuple(draw(st.lists(small, min_size=k, max_size=k))), tuple(
        draw(st.lists(decels, min_size=k, max_size=k))
    )


@settings(deadline=None)
@given(moves())
def test_the_whole_stop_is_a_straight_segment(move):
    u, d = move
    steps = np.array(stop_increments(u, d) or [[0.0] * len(u)])
    reach = 1.0 + stop_share(ticks_to_rest(u, d))
    assert steps.sum(axis=0) == pytest.approx(reach * np.array(u), abs=1e-9)


@settings(deadline=None)
@given(moves())
def test_no_joint_brakes_harder_than_its_deceleration_allows(move):
    u, d = move
    steps = [*stop_increments(u, d), (0.0,) * len(u)]
    for a, b in itertools.pairwise(steps):
        for x, y, most in zip(a, b, d, strict=True):
            assert abs(x - y) <= most * (1 + 1e-9) + 1e-12
            assert x * y >= 0.0


@settings(deadline=None)
@given(moves())
def test_the_remainder_of_a_stop_is_the_stop_from_its_next_increment(move):
    u, d = move
    steps = stop_increments(u, d)
    for k in range(1, len(steps)):
        again = np.array(stop_increments(steps[k], d))
        rest = np.array(steps[k:])
        assert again.sum(axis=0) == pytest.approx(rest.sum(axis=0), abs=1e-9)


def test_no_deceleration_bound_means_an_immediate_stop():
    assert stop_increments((0.1, -0.2), (math.inf, math.inf)) == ((0.1, -0.2),)
    assert stop_increments((0.0, 0.0), (0.1, 0.1)) == ()


@settings(deadline=None)
@given(st.floats(0.0, 2.0), st.floats(1e-3, 0.5))
def test_the_largest_stoppable_increment_just_fits(room, decel):
    u = largest_stoppable_increment(room, decel)
    length = sum(x for (x,) in stop_increments((u,), (decel,)))
    assert length <= room + 1e-9
    more = sum(x for (x,) in stop_increments((u + 1e-6,), (decel,)))
    assert more > room - 1e-9


@settings(deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(1e-3, 0.2), st.floats(1e-3, 0.2), st.floats(-1, 1))
def test_the_acceleration_box_holds_the_increments_possible_in_a_tick(last, accel, decel, u):
    low, high = acceleration_box(last, accel, decel)
    assert low <= last <= high
    if u * last < 0:
        may = abs(last) / decel + abs(u) / accel <= 1.0
    elif abs(u) > abs(last):
        may = abs(u) - abs(last) <= accel
    else:
        may = abs(last) - abs(u) <= decel
    inside = low <= u <= high
    near = min(abs(u - low), abs(u - high)) < 1e-9
    assert inside == may or near


@st.composite
def situations(draw):
    """Return a robot that moves inside its limits, and any requested increment."""
    n = draw(st.integers(1, 6))

    def row(elements):
        return tuple(draw(st.lists(elements, min_size=n, max_size=n)))

    speed, accel, decel = row(st.floats(1e-3, 0.1)), row(st.floats(1e-4, 0.05)), row(
        st.one_of(st.floats(1e-4, 0.05), st.just(math.inf)))  # fmt: skip
    bounds = StepBounds(tuple(f"J{k}" for k in range(n)), (-1.0,) * n, (1.0,) * n, speed, accel, decel)
    setpoint = row(st.floats(-1.0, 1.0))
    last = (0.0,) * n
    for _ in range(draw(st.integers(0, 6))):
        u = limit_increment(row(st.floats(-0.3, 0.3)), last, brake_of(last, decel), setpoint, bounds, 1.0).u
        assume(first_outside(u, setpoint, bounds) is None)
        setpoint, last = tuple(q + x for q, x in zip(setpoint, u, strict=True)), u
    requested = row(st.one_of(st.floats(-0.3, 0.3), st.sampled_from([0.0, 1e-15, -1e-9, 1e300, -5e-324])))
    return requested, last, setpoint, bounds


def brake_of(last, decel):
    steps = stop_increments(last, decel)
    return steps[1] if len(steps) > 1 else (0.0,) * len(last)


@settings(max_examples=300, deadline=None)
@given(situations(), st.floats(0.05, 1.0))
def test_a_limited_increment_is_always_possible(situation, share):
    requested, last, setpoint, bounds = situation
    brake = brake_of(last, bounds.decel)
    limited = limit_increment(requested, last, brake, setpoint, bounds, share)
    assert 0.0 <= limited.beta <= 1.0
    for j, x in enumerate(limited.u):
        assert abs(x) <= bounds.speed[j] + 1e-12
        low, high = acceleration_box(last[j], bounds.accel[j], bounds.decel[j])
        assert low - 1e-9 <= x <= high + 1e-9
    ends = np.array(setpoint) + np.sum(
        stop_increments(limited.u, bounds.decel) or [(0.0,) * len(last)], axis=0
    )
    assert np.all(np.abs(ends) <= 1.0 + 1e-9)
    if not limited.reasons:
        assert np.allclose(limited.u, requested, atol=1e-11)


def test_one_joint_at_its_limit_does_not_freeze_the_others():
    bounds = StepBounds(("a", "b"), (-1.0, -1.0), (1.0, 1.0), (0.1, 0.1), (0.05, 0.05), (0.05, 0.05))
    limited = limit_increment((0.05, 0.05), (0.0, 0.0), (0.0, 0.0), (1.0, 0.0), bounds, 1.0)
    assert limited.u == (0.0, 0.05)
    assert [r.cause for r in limited.reasons] == ["joint_limit"]


def test_a_lease_may_lower_the_speed_bound():
    bounds = StepBounds(("a",), (-1.0,), (1.0,), (0.1,), (1.0,), (1.0,))
    assert limit_increment((0.1,), (0.0,), (0.0,), (0.0,), bounds, 0.25).u == (0.025,)


# --- occupancy --------------------------------------------------------------------------------------------

points = st.integers(1, 5).flatmap(
    lambda n: st.tuples(
        st.lists(st.tuples(*[small] * n), min_size=3, max_size=3),
        st.lists(st.tuples(*[small] * n), max_size=5),
        st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8),
    )
)


def within(q, one):
    """Return True if a position is in polyline ⊕ tube, by sampling the polyline in small steps."""
    nodes = np.array(one.nodes)
    if len(nodes) == 1:
        nodes = np.repeat(nodes, 2, axis=0)
    share = np.linspace(0, 1, 2001)[:, None]
    line = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(nodes)])
    coarse = np.abs(np.diff(nodes, axis=0)).max(axis=0) / 2000
    return bool(np.any(np.all(np.abs(line - q) <= np.array(one.tube) + coarse + 1e-9, axis=1)))


@settings(max_examples=300, deadline=None)
@given(points)
def test_every_position_of_the_hull_is_inside_the_cover(given_points):
    (a, b, c), history, weights = given_points
    one = occupancy(a, b, c, history, 0.0)
    everything = np.array([a, b, c, *history])
    w = np.array(weights[: len(everything)])
    assume(w.sum() > 1e-3)
    assert within(w @ everything / w.sum(), one)
    assert all(within(np.array(x), one) for x in everything)


@settings(deadline=None)
@given(points)
def test_a_measurement_on_the_path_is_not_changed(given_points):
    (a, b, c), history, weights = given_points
    one = occupancy(a, b, c, history, 1e-4)
    on = tuple(x + weights[0] * (y - x) for x, y in zip(a, b, strict=True))
    assert settle_measured(on, [one], 1e-4) == on
    assert deviation(on, one) <= 1e-12


@settings(deadline=None)
@given(points)
def test_a_measurement_far_off_the_path_is_not_explained(given_points):
    (a, b, c), _, _ = given_points
    one = occupancy(a, b, c, [], 1e-4)
    assert settle_measured(tuple(5.0 + x for x in a), [one], 1e-4) is None
    assert deviation(tuple(5.0 + x for x in a), one) > 1.0


@settings(max_examples=400, deadline=None)
@given(points, st.lists(st.floats(-1.0, 1.0), min_size=20, max_size=20))
def test_rounding_never_hides_the_true_position(given_points, noise):
    """The true position is on the path; the position taken from an inexact measurement is no farther off."""
    (a, b, c), history, weights = given_points
    tolerance = 1e-2
    rounded = occupancy(a, b, c, history, tolerance)
    everything = np.array([a, b, c, *history])
    w = np.array(weights[: len(everything)])
    assume(w.sum() > 1e-3)
    true = w @ everything / w.sum() + tolerance * np.array(noise[10:][: len(a)])  # a was measured, too
    measured = true + tolerance * np.array(noise[: len(true)])
    settled = settle_measured(tuple(map(float, measured)), [rounded], tolerance)
    assert settled is not None
    assert np.all(np.abs(np.array(settled) - true) <= tolerance + 1e-8)
