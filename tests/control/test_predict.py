import numpy as np
import pytest

from armgate.control.predict import Predictor, ramp_lag

T = 0.012


def test_constant_velocity_is_estimated_exactly():
    predictor, v = Predictor(gamma=0.0, beta=0.1), np.array([0.2, -0.1, 0.05])
    for k in range(400):
        predictor.update(k * T, 1.0 + k * T * v)
    p, speed = predictor.predict(0.05)
    np.testing.assert_allclose(p, 1.0 + (399 * T + 0.05) * v, atol=1e-9)
    np.testing.assert_allclose(speed, v, atol=1e-8)


def test_constant_acceleration_is_estimated_exactly_with_gamma():
    predictor, a = Predictor(), np.array([0.2, -0.1, 0.05])
    for k in range(2000):
        predictor.update(k * T, 0.5 * a * (k * T) ** 2)
    np.testing.assert_allclose(predictor.predict(0.05)[0], 0.5 * a * (1999 * T + 0.05) ** 2, atol=1e-6)


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.12])
def test_ramp_lag_is_the_delay_of_a_first_order_lag_on_a_ramp(lag):
    q, keep = 0.0, np.exp(-T / lag) if lag else 0.0
    for k in range(1000):
        q = k * T + keep * (q - k * T)
    assert 999 * T - q == pytest.approx(ramp_lag(lag, T), abs=1e-12)


def test_lost_samples_are_tolerated():
    predictor, v = Predictor(), np.array([0.2, 0.0, 0.0])
    for k in range(600):
        if k % 7 not in (2, 3):
            predictor.update(k * T, k * T * v)
    np.testing.assert_allclose(predictor.predict(T)[0], 600 * T * v, atol=1e-6)


def test_old_and_repeated_positions_are_ignored():
    predictor = Predictor()
    predictor.update(1.0, [1.0, 0.0, 0.0])
    for stale in (1.0, 0.5):
        predictor.update(stale, [9.0, 9.0, 9.0])
    np.testing.assert_array_equal(predictor.predict(0.0)[0], [1.0, 0.0, 0.0])
    assert predictor.time == 1.0


def test_a_pause_restarts_the_filter():
    predictor = Predictor(gap=0.2)
    for k in range(20):
        predictor.update(k * T, [k * T, 0.0, 0.0])
    assert predictor.velocity[0] > 0.5
    predictor.update(1.0, [5.0, 0.0, 0.0])
    np.testing.assert_array_equal(predictor.predict(1.0)[0], [5.0, 0.0, 0.0])


def test_predict_before_the_first_position_is_an_error():
    with pytest.raises(ValueError, match="no position"):
        Predictor().predict(0.1)


@pytest.mark.parametrize("bad", [[1.0, 2.0], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]])
def test_bad_positions_are_refused(bad):
    with pytest.raises(ValueError, match="three finite"):
        Predictor().update(0.0, bad)
