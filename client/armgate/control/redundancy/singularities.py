"""Away from singularities (slide 41): the gradient of the manipulability measure w."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.measures import manipulability
from armgate.control.redundancy.spaces import Array
from armgate.control.redundancy.tasks import Task


class AwayFromSingularities:
    """V = −w, w = √det(JJᵀ) of a task.

    With J = Σ σ_i u_i v_iᵀ, ∂σ_i/∂q_k = u_iᵀ(∂J/∂q_k)v_i, so

        ∂w/∂q_k = Σ_i (Π_{j≠i} σ_j) u_iᵀ(∂J/∂q_k)v_i = w tr(J⁺ ∂J/∂q_k),

    the first form without a division by what goes to zero. The lecture takes the gradient of det(JJᵀ) = w²:
    2w ∂w/∂q, the same direction but vanishing where it is needed. In a singularity w has a kink, and this is
    the gradient on one of its two sides, which leads away as well.
    """

    def __init__(self, task: Task[Any]) -> None:
        self._task = task

    def potential(self, q: ArrayLike) -> float:
        """−w at q."""
        return -manipulability(self._task.jacobian(q))

    def gradient(self, q: ArrayLike) -> Array:
        """∂V/∂q (n,)."""
        U, sigma, Vt = np.linalg.svd(self._task.jacobian(q), full_matrices=False)
        others = np.array([np.prod(np.delete(sigma, i)) for i in range(len(sigma))])
        slope = (U * others) @ Vt  # ∂w/∂J
        gradient: Array = -np.tensordot(slope, self._task.jacobian_derivative(q), axes=2)
        return gradient
