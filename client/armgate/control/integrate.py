"""The on-line scheme, equations (16) and (17): the law is integrated within a tick as far as makes sense.

The reference q^r starts at the robot's position (17), or where the target's known motion takes it within
the tick, and follows q̇^r = f(q^r) (16) in virtual time by the explicit Runge-Kutta method of 4th order. It
ends when a joint has left its reach (the increment bound, or what is needed to brake for it), when the
budget of steps is used up, or, saving time, when the rest of the way is not worth a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from armgate.control.weights import Vector

Field = Callable[[Vector], Vector]


class Ended(Enum):
    """Why the integration ended."""

    CONVERGED = "converged"
    BOUND = "bound"
    BUDGET = "budget"


@dataclass(frozen=True, slots=True)
class Integration:
    """Where the reference came to.

    Attributes:
        q: the last q^r, (n,).
        steps: Runge-Kutta steps made.
        ended: why no more.
    """

    q: Vector
    steps: int
    ended: Ended


@dataclass(frozen=True, slots=True)
class Scheme:
    """How (16) is integrated.

    Attributes:
        step: longest step in virtual time, s. With gains of 5/s, 0.2 s is one time constant: stable, and 2
            % exact.
        budget: at most this many steps.
        split: no step moves a joint by more than this part of its reach.
        resolution: a rest of the way below this, rad or m, is not worth a step …
        tolerance: … nor one below this part of the way made.
        turn: longest step in units of the field's own time, h ‖∂f/∂q‖/2. Where repulsion meets a pull the
            field is stiff, and longer steps would cast the reference to and fro.
    """

    step: float = 0.2
    budget: int = 12
    split: float = 1.0 / 3.0
    resolution: float = 2e-6
    tolerance: float = 0.05
    turn: float = 1.0

    @property
    def numbers(self) -> tuple[float, int, float, float, float, float]:
        """All of them in this order, for the compiled form."""
        return self.step, self.budget, self.split, self.resolution, self.tolerance, self.turn


def rk4(f: Field, q: Vector, h: float, k1: Vector) -> Vector:
    """One step of the classical Runge-Kutta method from q over h, k1 being f(q)."""
    return rk4_turn(f, q, h, k1)[0]


def rk4_turn(f: Field, q: Vector, h: float, k1: Vector) -> tuple[Vector, float]:
    """The same, and h ‖∂f/∂q‖/2 as its stages show it: ‖k3 − k2‖ / ‖k2 − k1‖.

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
    """Integrate (16) from `start` until a joint is its `reach` (n,) away, or the scheme ends it.

    Args:
        f: the law.
        start: where the reference starts, (n,).
        reach: how far a joint goes from the origin, (n,).
        scheme: steps and budget.
        origin: the robot's position (17), from which the way made is counted; `start` by default.
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
