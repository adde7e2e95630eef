import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.control.bounds import IncrementBounds
from armgate.control.shaping import RESERVE, braking_increment, braking_way, shape_chord

RATES = {
    "lower": [-1.0, -0.5, -2.0],
    "upper": [1.0, 0.5, 2.0],
    "velocity": [2.0, 1.0, 6.0],
    "acceleration": [8.0, 4.0, 24.0],
    "period": 0.012,
}
BOUNDS = IncrementBounds.from_rates(**RATES)
requests = st.lists(st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3), min_size=1, max_size=60)


def _decay(dq, bounds):
    moving = np.abs(dq) > 1e-15
    return (bounds.change[moving] / np.abs(dq[moving])).min()


@settings(max_examples=200, deadline=None)
@given(requests, st.floats(-0.99, 0.99))
def test_any_sequence_of_requests_stays_within_all_bounds(sequence, start):
    setpoint, last = start * BOUNDS.upper, np.zeros(3)
    for request in sequence:
        dq = BOUNDS.within(np.array(request), last, setpoint)
        assert (np.abs(dq) <= BOUNDS.step + 1e-15).all()
        assert (np.abs(dq - last) <= BOUNDS.change + 1e-15).all()
        end = setpoint + (1.0 + BOUNDS.stop(dq)) * dq
        assert (end <= BOUNDS.upper + 1e-9).all()
        assert (end >= BOUNDS.lower - 1e-9).all()
        setpoint, last = setpoint + dq, dq


def test_a_request_within_the_bounds_is_unchanged():
    request = np.array([0.001, -0.0005, 0.003])
    np.testing.assert_array_equal(BOUNDS.within(request, np.zeros(3), np.zeros(3)), request)


def test_stop_equals_the_sum_of_braking_increments():
    dq = np.array([0.02, -0.01, 0.05])
    decay = _decay(dq, BOUNDS)
    shares = np.maximum(1.0 - decay * np.arange(1, 100), 0.0)
    assert BOUNDS.stop(dq) == pytest.approx(shares.sum())
    np.testing.assert_allclose(BOUNDS.braked(dq), dq * shares[0])
    assert BOUNDS.stop(np.zeros(3)) == 0.0


def test_a_joint_beyond_its_limit_only_returns():
    setpoint = np.array([1.1, 0.0, 0.0])
    assert BOUNDS.within(np.full(3, 0.001), np.zeros(3), setpoint)[0] == 0.0
    assert BOUNDS.within(np.full(3, -0.001), np.zeros(3), setpoint)[0] == -0.001


def test_speed_share_and_deceleration_bound():
    slow = IncrementBounds.from_rates(**RATES, deceleration=[np.inf, 2.0, 100.0], speed=0.5)
    np.testing.assert_allclose(slow.step, [0.012, 0.006, 0.036], rtol=1e-5)
    np.testing.assert_allclose(slow.change, np.array([8.0, 2.0, 24.0]) * 0.012**2, rtol=1e-5)


@pytest.mark.parametrize(
    "wrong", [{"velocity": [1.0, 2.0]}, {"period": 0.0}, {"acceleration": [1.0, 0.0, 1.0]}]
)
def test_invalid_rates_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        IncrementBounds.from_rates(**(RATES | wrong))


def test_braking_increment_and_braking_way_are_inverse_functions():
    way = np.geomspace(1e-6, 1.0, 30)
    np.testing.assert_allclose(braking_way(braking_increment(way, 1e-3), 1e-3), way, rtol=1e-9)


@pytest.mark.parametrize("way", [1e-4, 0.01, 0.3, 2.0])
def test_a_joint_that_follows_the_chord_neither_overshoots_nor_oscillates(way):
    step, change = np.array([0.03]), np.array([0.0015])
    q, last, at = 0.0, np.zeros(1), []
    for _ in range(400):
        u = shape_chord(np.array([way - q]), np.zeros(1), step, change)
        last = np.clip(u, last - change, last + change)
        q += float(last[0])
        at.append(q)
    assert max(at) <= way * (1.0 + 1e-9) + 1e-12
    assert at[-1] == pytest.approx(way)
    assert (np.diff(at) >= -1e-12).all()


def test_the_chord_keeps_its_direction():
    chord = np.array([0.5, -0.2, 0.1])
    u = shape_chord(chord, np.zeros(3), BOUNDS.step, BOUNDS.change)
    np.testing.assert_allclose(u / u[0], chord / chord[0])
    assert (np.abs(u) <= braking_increment(np.abs(chord), RESERVE * BOUNDS.change) + 1e-15).all()


def test_the_induced_motion_is_not_reduced_for_braking():
    induced = np.array([0.01, -0.004, 0.02])
    np.testing.assert_allclose(shape_chord(induced, induced, BOUNDS.step, BOUNDS.change), induced)


def test_the_middle_of_the_range():
    bounds = IncrementBounds(np.ones(2), np.ones(2), np.array([-1.0, 0.0]), np.array([3.0, 1.0]))
    low, high = bounds.middle(0.5)
    np.testing.assert_allclose(low, [0.0, 0.25])
    np.testing.assert_allclose(high, [2.0, 0.75])
