"""Null-space objectives (slides 41-42): potentials that a robot lowers in addition to its task.

away from singularities   V = −w, the manipulability measure
away from joint limits    V = ½ ‖q − q_m‖²
away from obstacles       V = ½ Σ max(0, ρ − d)²
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape
from armgate.control.redundancy.distance import point_distances
from armgate.control.redundancy.measures import manipulability
from armgate.control.redundancy.spaces import Array
from armgate.control.redundancy.tasks import Task
from armgate.control.spheres import Spheres


class Objective(Protocol):
    """Potential V(q) that is to be lowered."""

    def potential(self, q: ArrayLike) -> float:
        """Return V at q (n,)."""
        ...

    def gradient(self, q: ArrayLike) -> Array:
        """Return ∂V/∂q (n,), exact."""
        ...


def wanted_velocity(objectives: Sequence[tuple[Objective, float]], q: Array) -> Array:
    """Return q̇₀ = −Σ gain · ∂V/∂q (n,), down the gradients; `null_space_part` makes it a self-motion."""
    wanted: Array = np.zeros(len(q))
    for objective, gain in objectives:
        wanted = wanted - gain * objective.gradient(q)
    return wanted


class AwayFromSingularities:
    """Objective away from singularities (slide 41): V = −w, w = √det(JJᵀ) of a task.

    With J = Σ σ_i u_i v_iᵀ, ∂σ_i/∂q_k = u_iᵀ(∂J/∂q_k)v_i, so

        ∂w/∂q_k = Σ_i (Π_{j≠i} σ_j) u_iᵀ(∂J/∂q_k)v_i = w tr(J⁺ ∂J/∂q_k),

    where the first form needs no division by a number near zero. The lecture takes the gradient 2w ∂w/∂q of
    det(JJᵀ) = w²: the same direction, but zero in the singularity. In a singularity w has a kink, and this is
    the gradient on one of its two sides, which also leads away.
    """

    def __init__(self, task: Task[Any]) -> None:
        self._task = task

    def potential(self, q: ArrayLike) -> float:
        """Return −w at q."""
        return -manipulability(self._task.jacobian(q))

    def gradient(self, q: ArrayLike) -> Array:
        """Return ∂V/∂q (n,)."""
        U, sigma, Vt = np.linalg.svd(self._task.jacobian(q), full_matrices=False)
        others = np.array([np.prod(np.delete(sigma, i)) for i in range(len(sigma))])
        slope = (U * others) @ Vt  # ∂w/∂J
        gradient: Array = -np.tensordot(slope, self._task.jacobian_derivative(q), axes=2)
        return gradient


class TowardsCentre:
    """Objective away from joint limits (slide 41): V = ½ ‖q − q_m‖², q_m the middle of the range.

    Along its gradient every joint returns at the same rate, q̇₀ = gain · (q_m − q), with the gain in 1/s, for
    revolute and prismatic joints and for wide and narrow ranges.

    Args:
        lower: lower joint limits, rad or m, (n,).
        upper: upper joint limits.

    Raises:
        ValueError: if a joint has no range.
    """

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
        if low.shape != high.shape or low.ndim != 1 or not (high > low).all():
            raise ValueError(f"expected lower < upper for each joint, got {low} and {high}")
        self._middle = 0.5 * (low + high)

    def potential(self, q: ArrayLike) -> float:
        """Return V at q."""
        way = self.gradient(q)
        return 0.5 * float(way @ way)

    def gradient(self, q: ArrayLike) -> Array:
        """Return ∂V/∂q (n,)."""
        gradient: Array = np.asarray(q, dtype=np.float64) - self._middle
        return gradient


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """Primitive shape at a pose in the world."""

    shape: Shape
    placement: Placement


class AwayFromObstacles:
    """Objective away from obstacles (slide 42): V = ½ Σ max(0, ρ − d)² over control points x_i and obstacles.

    The control points are the centres of the robot's bounding spheres, d the distance between the sphere and
    the obstacle's surface. With n the unit vector away from the obstacle the gradient is −Σ (ρ − d) J_iᵀ n:
    the lecture's q̇₀ = Σ J_iᵀ(x_i − x_o), with a strength that decreases to 0 at ρ instead of growing with
    the distance. It remains finite if bodies overlap, and separates them.

    Args:
        model: The robot.
        obstacles: The obstacles.
        reach: ρ, m: obstacles further away have no effect.

    Raises:
        ValueError: ρ is not positive.
    """

    def __init__(self, model: RobotModel, obstacles: Sequence[Obstacle], reach: float) -> None:
        if not reach > 0.0:
            raise ValueError(f"expected a reach > 0, got {reach}")
        self._model = model
        self._spheres = Spheres.of(model)
        self._obstacles = tuple(obstacles)
        self._reach = reach

    def potential(self, q: ArrayLike) -> float:
        """Return V at q, m²."""
        return 0.5 * sum(float(depth @ depth) for depth, _ in self._pushes(self._centres(q)))

    def gradient(self, q: ArrayLike) -> Array:
        """Return ∂V/∂q (n,), m² per rad or m."""
        centres = self._centres(q)
        forces = np.zeros_like(centres)
        for depth, n in self._pushes(centres):
            forces += depth[:, None] * n
        gradient: Array = np.zeros(self._model.n)
        for i in np.flatnonzero(forces.any(axis=1)):
            J = self._model.point_jacobian(q, self._spheres.joints[i], centres[i])
            gradient -= J.T @ forces[i]
        return gradient

    def least_distance(self, q: ArrayLike) -> float:
        """Return the smallest d at q, m; infinite without obstacles."""
        return min((float(d.min()) for d, _ in self._distances(self._centres(q))), default=np.inf)

    def _centres(self, q: ArrayLike) -> Array:
        return self._spheres.centres(np.asarray(q, dtype=np.float64))

    def _pushes(self, centres: Array) -> Iterator[tuple[Array, Array]]:
        """Yield for each obstacle max(0, ρ − d), (k,), and the directions away from it (k, 3)."""
        for d, n in self._distances(centres):
            yield np.maximum(self._reach - d, 0.0), n

    def _distances(self, centres: Array) -> Iterator[tuple[Array, Array]]:
        for obstacle in self._obstacles:
            d, n = point_distances(centres, obstacle.shape, obstacle.placement)
            yield d - self._spheres.radii, n
