"""Away from joint limits (slide 41): towards the middle of the joints' ranges."""

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array


class TowardsCentre:
    """V = ½ ‖q − q_m‖², q_m the middle of the range: the lecture's squared distance from the centre.

    Down its gradient every joint goes back at the same rate, q̇₀ = gain · (q_m − q), the gain in 1/s, be it
    revolute or prismatic and its range wide or narrow.

    Args:
        lower: joint limits, rad or m, (n,).
        upper: the same, upper.

    Raises:
        ValueError: if a joint has no range.
    """

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
        if low.shape != high.shape or low.ndim != 1 or not (high > low).all():
            raise ValueError(f"expected lower < upper for each joint, got {low} and {high}")
        self._middle = 0.5 * (low + high)

    def potential(self, q: ArrayLike) -> float:
        """V at q."""
        way = self.gradient(q)
        return 0.5 * float(way @ way)

    def gradient(self, q: ArrayLike) -> Array:
        """∂V/∂q (n,)."""
        gradient: Array = np.asarray(q, dtype=np.float64) - self._middle
        return gradient
