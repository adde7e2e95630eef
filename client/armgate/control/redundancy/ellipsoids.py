"""Velocity and force ellipsoids (slides 14-26): effects of joint velocities, and of joint torques, of norm 1.

    {ẋ = Jq̇ : ‖q̇‖ ≤ 1}        = {ẋ : ẋᵀ(JJᵀ)⁻¹ẋ ≤ 1}     semi-axes u_i, lengths σ_i
    {F : τ = JᵀF, ‖τ‖ ≤ 1}     = {F : Fᵀ(JJᵀ)F ≤ 1}       semi-axes u_i, lengths 1/σ_i

The two have the same axes and reciprocal lengths: in the direction of the fastest motion the force is
smallest (slide 24 calls that orthogonal).
"""

from dataclasses import dataclass
from math import gamma, pi

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array, matrix, spaces


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """Ellipsoid around the origin of an m-dimensional space, flat where lengths are zero.

    Attributes:
        axes: directions of the semi-axes, orthonormal columns, (m, m).
        lengths: their lengths, (m,), in the order of the axes; infinite where the ellipsoid is unbounded.
    """

    axes: Array
    lengths: Array

    @property
    def semi_axes(self) -> Array:
        """Semi-axes as vectors, columns, (m, m)."""
        vectors: Array = self.axes * self.lengths
        return vectors

    @property
    def volume(self) -> float:
        """Volume of the ellipsoid: π^{m/2} / Γ(m/2 + 1) times the product of its lengths."""
        m = len(self.lengths)
        ball: float = pi ** (m / 2) / gamma(m / 2 + 1)
        return ball * float(np.prod(self.lengths))

    def map(self, directions: ArrayLike) -> Array:
        """Return the surface points (m, k) to which the unit vectors (m, k) are mapped."""
        points: Array = self.semi_axes @ (self.axes.T @ np.asarray(directions, dtype=np.float64))
        return points

    def projection(self, rows: ArrayLike) -> "Ellipsoid":
        """Return the projection of a bounded ellipsoid by a linear map (k, m), k ≤ m.

        Raises:
            ValueError: if the ellipsoid is unbounded, or the shape of the map does not fit.
        """
        P = matrix(rows)
        if not np.isfinite(self.lengths).all():
            raise ValueError("this ellipsoid is unbounded: its projection has no semi-axes")
        if P.shape[1] != len(self.lengths) or P.shape[0] > P.shape[1]:
            raise ValueError(f"expected a map (k ≤ {len(self.lengths)}, {len(self.lengths)}), got {P.shape}")
        U, sigma, _ = np.linalg.svd(P @ self.semi_axes)
        return Ellipsoid(U, sigma)


def velocity_ellipsoid(J: ArrayLike) -> Ellipsoid:
    """Return the ellipsoid of task velocities for joint velocities ‖q̇‖ ≤ 1 (slide 15), long axis first."""
    parts = spaces(J)
    lengths = np.zeros(parts.U.shape[0])
    lengths[: len(parts.sigma)] = parts.sigma
    lengths[parts.rank :] = 0.0
    return Ellipsoid(parts.U, lengths)


def force_ellipsoid(J: ArrayLike) -> Ellipsoid:
    """Return the ellipsoid of task forces for torques ‖τ‖ ≤ 1 (slide 23); unbounded if J is singular."""
    velocity = velocity_ellipsoid(J)
    with np.errstate(divide="ignore"):
        return Ellipsoid(velocity.axes, 1.0 / velocity.lengths)
