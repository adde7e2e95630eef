"""Away from joint limits (slide 41): towards the middle of the joints' ranges."""

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array


class TowardsCentre:
    """V = ½ Σ ((q_j − m_j) / h_j)², m the middle of the range and h half of it.

    The lecture's squared distance from the centre, counted in half ranges (Liégeois 1977), so that rad and m
    may stand beside each other and a limit is at 1 for every joint.

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
        self._half = 0.5 * (high - low)

    def potential(self, q: ArrayLike) -> float:
        """V at q."""
        x = (np.asarray(q) - self._middle) / self._half
        return 0.5 * float(x @ x)

    def gradient(self, q: ArrayLike) -> Array:
        """∂V/∂q (n,)."""
        gradient: Array = (np.asarray(q) - self._middle) / self._half**2
        return gradient
