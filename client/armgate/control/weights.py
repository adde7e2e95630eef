"""Joint limit weights, equations (10) and (11), free of units.

    H_j = c · 8 x / (1 − x²)²,   W⁻¹_jj = 1 / (1 + H_j²),   x = (2 q − q_M − q_m) / (q_M − q_m)   (10), (11)

(11) as printed has the unit 1/angle, so that radians or degrees make another controller of it: it is H
above with c = 2 / (q_M − q_m). Here x is the position in the half range and c is a number. A joint is
weighed only while it approaches its limit, as Chan and Dubey (1995) do: one that leaves it is free to do
so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class LimitWeights:
    """W⁻¹ of (10) for the limits `lower` and `upper` ((n,), rad or m) and the strength c.

    Raises:
        ValueError: where a joint has no range (upper ≤ lower), or c ≤ 0.
    """

    def __init__(self, lower: Vector, upper: Vector, c: float) -> None:
        if not np.all(upper > lower):
            raise ValueError(f"joint limits need lower < upper, got lower {lower} and upper {upper}")
        if not c > 0.0:
            raise ValueError(f"expected a strength c > 0 of the limit weights, got {c}")
        self._slope = 2.0 / (upper - lower)
        self._offset = (upper + lower) / (upper - lower)
        self._squared_c = (8.0 * c) ** 2

    def position(self, q: Vector) -> Vector:
        """x: −1 at the lower limit, 0 in the middle, 1 at the upper limit."""
        x: Vector = q * self._slope - self._offset
        return x

    def inverse(self, x: Vector) -> Vector:
        """The diagonal of W⁻¹ at the positions x: 1 in the middle, 0 at the limits and beyond.

        1/(1 + H²) multiplied out, so that nothing is divided by zero at a limit.
        """
        xx = x * x
        m = np.maximum(1.0 - xx, 0.0)
        m *= m
        m *= m
        w: Vector = m / (m + self._squared_c * xx)
        return w
