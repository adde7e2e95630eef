"""On-line scheme (16), (17): within a tick the law is integrated as far as is useful.

The reference q^r starts at the robot's position (17). If the motion of the target is known, it starts at the
position to which this motion takes the robot within the tick. It follows q̇^r = f(q^r) (16) in virtual time
by the explicit Runge-Kutta method of 4th order. The integration ends when a joint is farther from the robot's
position than its reach (the increment bound, or a braking distance), when the budget of steps is used up, or,
to save time, when the remaining distance is too small for a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from armgate.control.weights import Vector

Field = Callable[[Vector], Vector]


class Ended(Enum):
    """Reason for the end of the integration."""

    CONVERGED = "converged"
    BOUND = "bound"
    BUDGET = "budget"


@dataclass(frozen=True, slots=True)
class Integration:
    """Result of the integration.

    Attributes:
        q: last q^r, (n,).
        steps: Runge-Kutta steps made.
        ended: reason for the end.
    """

    q: Vector
    steps: int
    ended: Ended


@dataclass(frozen=True, slots=True)
class Scheme:
    """Parameters of the integration of (16).

    Attributes:
        step: longest step in virtual time, s. With gains of 5/s, 0.2 s is one time constant: stable, and
            accurate to 2 %.
        budget: largest number of steps.
        split: largest share of its reach by which a step moves a joint.
        resolution: remaining distance below which the integration ends, rad or m.
        tolerance: the same, as a share of the distance covered; the larger of both applies.
        turn: largest h ‖∂f/∂q‖/2 of a step h. The field is stiff where repulsion opposes an attraction, and
            with longer steps the reference would oscillate.
    """

    step: float = 0.2
    budget: int = 12
    split: float = 1.0 / 3.0
    resolution: float = 2e-6
    tolerance: float = 0.05
    turn: float = 1.0

    @property
    def numbers(self) -> tuple[float, int, float, float, float, float]:
        """All parameters in this order, for the compiled form."""
        return self.step, self.budget, self.split, self.resolution, self.tolerance, self.turn


def rk4(f: Field, q: Vector, h: float, k1: Vector) -> Vector:
    """Return one step of the classical Runge-Kutta method from q over h; k1 is f(q)."""
    return rk4_turn(f, q, h, k1)[0]


def rk4_turn(f: Field, q: Vector, h: float, k1: Vector) -> tuple[Vector, float]:
    """Return the step, and h ‖∂f/∂q‖/2 estimated by its stages: ‖k3 − k2‖ / ‖k2 − k1‖.

    The stages lie h (k2 − k1)/2 apart, so that the field changes by about ∂f/∂q times this between them. The
    method is stable for real eigenvalues down to −2.8/h, which is a ratio of 1.4.
    """
    k2 = f(q + 0.5 * h * k1)
    k3 = f(q + 0.5 * h * k2)
    k4 = f(q + h * k3)
    changed = float(np.abs(k2 - k1).max())
    turn = float(np.abs(k3 - k2).max()) / changed if changed > 0.0 else 0.0
    return q + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), turn


def integrate(
    f: Field, start: Vector, reach: Vector, scheme: Scheme, origin: Vector | None = None
) -> Integration:
    """Integrate (16) from `start` until a joint is `reach` (n,) away from `origin`, or the scheme ends.

    Args:
        f: the law.
        start: start of the reference, (n,).
        reach: largest distance of a joint from the origin, (n,).
        scheme: steps and budget.
        origin: robot's position (17), from which distances are counted; `start` by default.
    """
    origin = start if origin is None else origin
    q, largest_step, longest = start, scheme.split * reach, scheme.step
    for steps in range(scheme.budget):
        k1 = f(q)
        way = scheme.step * float(np.abs(k1).max())
        made = np.abs(q - origin)
        if way <= max(scheme.resolution, scheme.tolerance * float(made.max())):
            return Integration(q, steps, Ended.CONVERGED)
        if (made >= reach).any():
            return Integration(q, steps, Ended.BOUND)
        slowest = float((np.abs(k1) / largest_step).max())
        h = min(longest, 1.0 / slowest) if slowest > 0.0 else longest
        ahead, turn = rk4_turn(f, q, h, k1)
        if turn > scheme.turn:
            longest = 0.5 * h / turn
            continue
        q, longest = ahead, min(scheme.step, 2.0 * h)
    ended = Ended.BOUND if (np.abs(q - origin) >= reach).any() else Ended.BUDGET
    return Integration(q, scheme.budget, ended)
