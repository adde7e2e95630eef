"""What a robot may pursue beside its task: a potential, lowered along its gradient in the null space."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array


class Objective(Protocol):
    """A potential V(q) that shall become small."""

    def potential(self, q: ArrayLike) -> float:
        """V at q (n,)."""
        ...

    def gradient(self, q: ArrayLike) -> Array:
        """∂V/∂q (n,), exact."""
        ...


def wanted_velocity(objectives: Sequence[tuple[Objective, float]], q: Array) -> Array:
    """q̇₀ = −Σ gain · ∂V/∂q (n,): down the gradients; `null_space_part` makes a self motion of it."""
    wanted: Array = np.zeros(len(q))
    for objective, gain in objectives:
        wanted = wanted - gain * objective.gradient(q)
    return wanted
