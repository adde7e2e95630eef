import numpy as np
import pytest

from armgate.control.gains import Gains
from armgate.control.integrate import Ended, Scheme, integrate, rk4
from armgate.control.law import CameraLaw

FAR = np.full(6, 1e3)


def test_order_four_in_a_smooth_scene(fr):
    """Smooth: no repulsion, and limit weights so weak that their switch leaves no kink."""
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


def test_converges_and_says_so():
    run = integrate(lambda q: -5.0 * q, np.ones(6), FAR, Scheme(budget=50))
    assert run.ended is Ended.CONVERGED
    assert np.abs(run.q).max() < 0.05
    assert run.steps < 10


def test_rests_at_the_optimum():
    run = integrate(lambda q: -5.0 * q, np.zeros(6), FAR, Scheme())
    assert (run.ended, run.steps) == (Ended.CONVERGED, 0)


def test_ends_at_the_bound_and_hardly_beyond():
    reach = np.array([0.1, 1.0, 1.0, 1.0, 1.0, 1.0])
    run = integrate(lambda q: np.ones(6), np.zeros(6), reach, Scheme(step=10.0))
    assert run.ended is Ended.BOUND
    assert 0.1 <= run.q[0] <= 0.1 * (1.0 + Scheme().split) + 1e-12


def test_ends_with_its_budget():
    run = integrate(lambda q: np.ones(6), np.zeros(6), FAR, Scheme(step=0.1, budget=7))
    assert (run.ended, run.steps) == (Ended.BUDGET, 7)
    assert run.q[0] == pytest.approx(0.7)
