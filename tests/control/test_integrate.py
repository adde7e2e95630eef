import numpy as np
import pytest

from armgate.control.gains import Gains
from armgate.control.integrate import Ended, Scheme, integrate, rk4, rk4_turn
from armgate.control.law import CameraLaw

FAR = np.full(6, 1e3)


def test_order_four_in_a_smooth_scene(fr):
    """Check without repulsion and with weak limit weights, so that the law is smooth."""
    law = CameraLaw(fr.model, "camera", Gains(limit=1e-9))
    goal = law.goal([1.9, 0.4, 1.2], 1.0)

    def end(steps):
        q = np.array(fr.start)
        for _ in range(steps):
            q = rk4(lambda at: law(at, goal), q, 0.4 / steps, law(q, goal))
        return q

    exact = end(320)
    errors = [np.abs(end(steps) - exact).max() for steps in (5, 10, 20)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.7).all(), orders
    assert (orders < 4.5).all(), orders


def test_integration_converges_and_reports_it():
    run = integrate(lambda q: -5.0 * q, np.ones(6), FAR, Scheme(budget=50))
    assert run.ended is Ended.CONVERGED
    assert np.abs(run.q).max() < 0.05
    assert run.steps < 10


def test_a_start_at_the_optimum_takes_no_step():
    run = integrate(lambda q: -5.0 * q, np.zeros(6), FAR, Scheme())
    assert (run.ended, run.steps) == (Ended.CONVERGED, 0)


def test_the_integration_ends_at_the_bound_or_slightly_beyond_it():
    reach = np.array([0.1, 1.0, 1.0, 1.0, 1.0, 1.0])
    run = integrate(lambda q: np.ones(6), np.zeros(6), reach, Scheme(step=10.0))
    assert run.ended is Ended.BOUND
    assert 0.1 <= run.q[0] <= 0.1 * (1.0 + Scheme().split) + 1e-12


@pytest.mark.parametrize("rate", [5.0, 300.0, 30_000.0])
def test_a_stiff_field_is_approached_without_oscillation(rate):
    """Check a field with one stiff direction, as if repulsion opposes a pull: long steps would oscillate."""

    def f(q):
        return np.array([-rate * q[0], 1.0])

    start, reach = np.array([0.1, 0.0]), np.full(2, 1e3)
    schemes = [Scheme(budget=budget, tolerance=0.0) for budget in range(1, 30)]
    stiff, slow = np.array([integrate(f, start, reach, scheme).q for scheme in schemes]).T
    assert (np.diff(np.abs(stiff)) <= 0.0).all()
    assert (np.diff(slow) >= 0.0).all()
    assert slow[-1] > 0.0


def test_the_turn_of_a_step_is_that_of_its_field():
    A = np.diag([-3.0, -3.0])
    for h in (0.1, 0.5):
        q, turn = rk4_turn(lambda at: A @ at, np.ones(2), h, A @ np.ones(2))
        assert turn == pytest.approx(0.5 * h * 3.0)
        np.testing.assert_allclose(q, rk4(lambda at: A @ at, np.ones(2), h, A @ np.ones(2)))
    assert rk4_turn(np.ones_like, np.ones(2), 0.1, np.ones(2))[1] == 0.0


def test_the_integration_ends_if_its_budget_is_used_up():
    run = integrate(lambda q: np.ones(6), np.zeros(6), FAR, Scheme(step=0.1, budget=7))
    assert (run.ended, run.steps) == (Ended.BUDGET, 7)
    assert run.q[0] == pytest.approx(0.7)
