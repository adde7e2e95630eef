"""Self-motion manifolds (slide 29): joint positions with the same task pose.

{q : error(q) = 0} has the dimension of the null space, n − m if J is regular: a set of curves for one
redundant joint. A curve is traced by predictor and corrector (Allgower and Georg, "Numerical Continuation
Methods", 1990):

    predict   q ← q + h t,   t the unit vector in N(J) that continues the last direction
    correct   q ← q + J⁺e,   Newton's method on the error e, orthogonal to the curve

With more than one redundant joint t is the projection of the last direction: the curve goes straight through
the manifold.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.inverses import pseudoinverse
from armgate.control.redundancy.resolution import null_space_part
from armgate.control.redundancy.spaces import Array, spaces, vector
from armgate.control.redundancy.tasks import Task

P = TypeVar("P")

EXACT = 1e-12
"""Error at which the corrector ends, m and rad."""
CORRECTIONS = 8
SHORTEST = 2.0**-12
"""Smallest share to which the step is halved if the curve bends too much."""
STRAIGHT = 0.9
"""Cosine of the largest angle between the directions of two neighbouring points."""


class Ended(Enum):
    """Reason for the end of a curve."""

    CLOSED = "closed"
    LIMIT = "joint limit"
    BUDGET = "budget of points"
    STUCK = "no continuation"


@dataclass(frozen=True, slots=True, eq=False)
class SelfMotion:
    """Piece of a self-motion manifold.

    Attributes:
        q: points in order, (k, n); in a closed curve the last equals the first up to whole turns.
        ended: reason for the end.
    """

    q: Array
    ended: Ended


def trace_self_motion(
    task: Task[P],
    start: ArrayLike,
    *,
    step: float = 0.02,
    budget: int = 5000,
    along: ArrayLike | None = None,
    limited: bool = True,
) -> SelfMotion:
    """Trace the curve through `start` until it closes, reaches a joint limit, or the budget is used up.

    Args:
        task: task that is held at its pose at `start`.
        start: (n,), rad or m.
        step: distance between points, rad or m; smaller where the curve bends.
        budget: largest number of points.
        along: initial direction, (n,), which is projected; by default the first null vector.
        limited: True if joint limits end the curve; otherwise joints may turn any number of times, and a
            curve closes when all revolute joints have returned up to whole turns.

    Raises:
        ValueError: if there is no self-motion at the start, or none along `along`.
    """
    q = vector(start, task.model.n, "the start")
    curve = _Curve(task, task.place(q), limited)
    direction = curve.first_direction(q, along)
    points = [q]
    while len(points) < budget:
        ahead = curve.step(points[-1], direction, step)
        if ahead is None:
            return SelfMotion(np.array(points), Ended.STUCK)
        if not curve.within(ahead[0]):
            return SelfMotion(np.array(points), Ended.LIMIT)
        closing = curve.passes(q, points[-1], ahead[0])
        points.append(points[-1] + curve.way(points[-1], q) if closing else ahead[0])
        if closing:
            return SelfMotion(np.array(points), Ended.CLOSED)
        direction = ahead[1]
    return SelfMotion(np.array(points), Ended.BUDGET)


class _Curve(Generic[P]):
    """Manifold of one task at one pose."""

    def __init__(self, task: Task[P], place: P, limited: bool) -> None:
        self._task = task
        self._place = place
        self._limited = limited
        self._turning = np.array([joint.kind == "revolute" for joint in task.model.joints]) & (not limited)

    def first_direction(self, q: Array, along: ArrayLike | None) -> Array:
        J = self._task.jacobian(q)
        null = spaces(J).null
        if not null.shape[1]:
            raise ValueError(f"there is no self-motion at {q}: J has rank {len(q)}, the number of joints")
        if along is None:
            return np.asarray(null[:, 0])
        direction = self._unit(null_space_part(J, vector(along, len(q), "along")))
        if direction is None:
            raise ValueError(f"{along} has no part in the null space of the task")
        return direction

    def step(self, q: Array, direction: Array, h: float) -> tuple[Array, Array] | None:
        """Return the next point and the direction there; None if even the shortest step finds none."""
        shortest = h * SHORTEST
        while h >= shortest:
            ahead = self._correct(q + h * direction)
            onward = None if ahead is None else self._onward(ahead, direction)
            if ahead is not None and onward is not None:
                return ahead, onward
            h *= 0.5
        return None

    def _correct(self, q: Array) -> Array | None:
        for _ in range(CORRECTIONS):
            e = self._task.error(q, self._place)
            if float(np.abs(e).max()) <= EXACT:
                return q
            q = q + pseudoinverse(self._task.jacobian(q)) @ e
        return None

    def _onward(self, q: Array, direction: Array) -> Array | None:
        onward = self._unit(null_space_part(self._task.jacobian(q), direction))
        return onward if onward is not None and float(onward @ direction) >= STRAIGHT else None

    @staticmethod
    def _unit(direction: Array) -> Array | None:
        length = float(np.linalg.norm(direction))
        return direction / length if length > 1e-6 else None

    def within(self, q: Array) -> bool:
        model = self._task.model
        return not self._limited or bool(((q >= model.lower) & (q <= model.upper)).all())

    def way(self, a: Array, b: Array) -> Array:
        """Return b − a, without whole turns of joints that may turn any number of times."""
        way = b - a
        return np.where(self._turning, np.remainder(way + np.pi, 2.0 * np.pi) - np.pi, way)

    def passes(self, q: Array, a: Array, b: Array) -> bool:
        """Return True if the step from a to b passes q: q lies between them, not beside."""
        along, to_q = b - a, self.way(a, q)
        share = float(to_q @ along) / float(along @ along)
        aside = to_q - share * along
        return 0.0 < share <= 1.0 and float(aside @ aside) < 0.01 * float(along @ along)
