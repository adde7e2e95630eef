"""Velocity and force ellipsoids (slides 14-26): what a joint velocity, a joint torque, of length 1 can do.

    {ẋ = Jq̇ : ‖q̇‖ ≤ 1}        = {ẋ : ẋᵀ(JJᵀ)⁻¹ẋ ≤ 1}     semi-axes u_i, lengths σ_i
    {F : τ = JᵀF, ‖τ‖ ≤ 1}     = {F : Fᵀ(JJᵀ)F ≤ 1}       semi-axes u_i, lengths 1/σ_i

The two have the same axes and reciprocal lengths: where the robot moves fastest it pushes least (slide 24
calls that orthogonal).
"""

from dataclasses import dataclass
from math import gamma, pi

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array, matrix, spaces


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """An ellipsoid around the origin of an m-dimensional space, flat where lengths are zero.

    Attributes:
        axes: directions of the semi-axes, orthonormal columns, (m, m).
        lengths: their lengths, (m,), in the order of the axes; infinite where nothing bounds it.
    """

    axes: Array
    lengths: Array

    @property
    def semi_axes(self) -> Array:
        """The semi-axes as vectors, columns, (m, m)."""
        vectors: Array = self.axes * self.lengths
        return vectors

    @property
    def volume(self) -> float:
        """Of the ellipsoid; π^{m/2} / Γ(m/2 + 1) times the product of its lengths."""
        m = len(self.lengths)
        ball: float = pi ** (m / 2) / gamma(m / 2 + 1)
        return ball * float(np.prod(self.lengths))

    def map(self, directions: ArrayLike) -> Array:
        """The points of its surface that belong to unit vectors (m, k), (m, k)."""
        points: Array = self.semi_axes @ (self.axes.T @ np.asarray(directions, dtype=np.float64))
        return points

    def projection(self, rows: ArrayLike) -> "Ellipsoid":
        """Its shadow under a linear map (k, m), k ≤ m, of a bounded ellipsoid.

        Raises:
            ValueError: if the ellipsoid is not bounded, or the map does not fit.
        """
        P = matrix(rows)
        if not np.isfinite(self.lengths).all():
            raise ValueError("this ellipsoid is not bounded: its shadow has no semi-axes")
        if P.shape[1] != len(self.lengths) or P.shape[0] > P.shape[1]:
            raise ValueError(f"expected a map (k ≤ {len(self.lengths)}, {len(self.lengths)}), got {P.shape}")
        U, sigma, _ = np.linalg.svd(P @ self.semi_axes)
        return Ellipsoid(U, sigma)


def velocity_ellipsoid(J: ArrayLike) -> Ellipsoid:
    """Task velocities of joint velocities ‖q̇‖ ≤ 1 (slide 15), longest axis first."""
    parts = spaces(J)
    lengths = np.zeros(parts.U.shape[0])
    lengths[: len(parts.sigma)] = parts.sigma
    lengths[parts.rank :] = 0.0
    return Ellipsoid(parts.U, lengths)


def force_ellipsoid(J: ArrayLike) -> Ellipsoid:
    """Task forces of joint torques ‖τ‖ ≤ 1 (slide 23), shortest axis first; unbounded where J is singular."""
    velocity = velocity_ellipsoid(J)
    with np.errstate(divide="ignore"):
        return Ellipsoid(velocity.axes, 1.0 / velocity.lengths)
