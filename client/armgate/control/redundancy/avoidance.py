"""Away from obstacles (slide 42): control points on the robot keep their distance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape
from armgate.control.redundancy.distance import point_distances
from armgate.control.redundancy.spaces import Array
from armgate.control.spheres import Spheres


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A primitive shape that stands somewhere in the world."""

    shape: Shape
    placement: Placement


class AwayFromObstacles:
    """V = ½ Σ max(0, ρ − d)² over control points x_i and obstacles.

    The control points are the centres of the robot's bounding spheres, d the distance between the sphere and
    the obstacle's surface. With n the unit vector away from the obstacle the gradient is −Σ (ρ − d) J_iᵀ n:
    the lecture's q̇₀ = Σ J_iᵀ(x_i − x_o), with a strength that fades to nothing at ρ instead of growing with
    the distance. It stays finite where bodies overlap, and leads apart.

    Args:
        model: The robot.
        obstacles: What to keep away from.
        reach: ρ, m: farther obstacles do not matter.

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
        """V at q, m²."""
        return 0.5 * sum(float(depth @ depth) for depth, _ in self._pushes(self._centres(q)))

    def gradient(self, q: ArrayLike) -> Array:
        """∂V/∂q (n,), m² per rad or m."""
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
        """Least d at q, m; infinite without obstacles."""
        return min((float(d.min()) for d, _ in self._distances(self._centres(q))), default=np.inf)

    def _centres(self, q: ArrayLike) -> Array:
        return self._spheres.centres(np.asarray(q, dtype=np.float64))

    def _pushes(self, centres: Array) -> Iterator[tuple[Array, Array]]:
        """For each obstacle ρ − d where that is positive, else 0, (k,), and the directions away (k, 3)."""
        for d, n in self._distances(centres):
            yield np.maximum(self._reach - d, 0.0), n

    def _distances(self, centres: Array) -> Iterator[tuple[Array, Array]]:
        for obstacle in self._obstacles:
            d, n = point_distances(centres, obstacle.shape, obstacle.placement)
            yield d - self._spheres.radii, n
