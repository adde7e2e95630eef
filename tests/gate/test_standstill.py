"""Standstill by measurements alone: noise within the tolerance is not motion, and slow motion is not rest."""

import random

import pytest

from armgate.gate.standstill import StandstillDetector, within

T = 0.004


def noted(tolerance, places, period=T):
    """Return one flag per measured position: True if standstill is reached after it."""
    stillness, reached = StandstillDetector(tolerance, period), []
    for q in places:
        stillness.add(q)
        reached.append(stillness.reached)
    return reached


def test_without_a_tolerance_two_ticks_within_a_micrometre_are_standstill():
    assert noted(0.0, [(0.0,), (0.9e-6,), (1.1e-6,), (2.0e-6,)]) == [False, True, False, True]


@pytest.mark.parametrize(
    ("tolerance", "period", "ticks"), [(1e-6, T, 4), (1e-5, T, 40), (1e-3, T, 125), (1e-3, 0.012, 42)]
)
def test_a_larger_tolerance_needs_a_longer_standstill_up_to_half_a_second(tolerance, period, ticks):
    reached = noted(tolerance, [(0.0,)] * 200, period)
    assert reached.index(True) == ticks
    assert all(reached[ticks:])


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4, 1e-3])
def test_noise_within_the_tolerance_is_not_motion(tolerance):
    rng = random.Random(1)
    places = [
        (0.3 + rng.choice((-1.0, 1.0)) * tolerance, rng.uniform(-1, 1) * tolerance) for _ in range(1000)
    ]
    reached = noted(tolerance, places)
    assert all(reached[125:])


@pytest.mark.parametrize("tolerance", [0.0, 1e-6, 1e-4, 1e-3])
def test_motion_distinguishable_from_noise_in_half_a_second_is_not_standstill(tolerance):
    rng = random.Random(1)
    speed = max(8.5 * tolerance, 2.0 * 1e-6 / T)  # per s
    places = [(speed * T * k + rng.uniform(-1, 1) * tolerance,) for k in range(2000)]
    assert not any(noted(tolerance, places))


def test_standstill_is_not_reached_before_the_first_tick_and_after_a_restart():
    stillness = StandstillDetector(0.0, T)
    assert not stillness.reached
    stillness.add((0.0,))
    stillness.add((0.0,))
    assert stillness.reached
    stillness.restart()
    assert not stillness.reached
    stillness.add((0.0,))
    assert not stillness.reached


def test_every_joint_must_stay_within_the_tolerance():
    assert within((0.0, 1.0), (0.1, 1.1), 0.11)
    assert not within((0.0, 1.0), (0.1, 1.2), 0.11)
