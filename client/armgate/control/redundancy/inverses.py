"""Inverses of a Jacobian: from a task velocity ẋ to joint velocities q̇ (slides 10-13).

    pseudoinverse           J⁺ = Jᵀ(JJᵀ)⁻¹                 exact, the shortest q̇; ‖q̇‖ ≤ ‖ẋ‖ / σ_min
    weighted                J_w⁺ = W⁻¹Jᵀ(JW⁻¹Jᵀ)⁻¹         exact, the least q̇ᵀWq̇
    transpose               Jᵀ                             not exact: reduces the error; ‖q̇‖ ≤ σ_max ‖ẋ‖
    damped least squares    J* = Jᵀ(JJᵀ + k²I)⁻¹           nearly exact; ‖q̇‖ ≤ ‖ẋ‖ / 2k

All are J's singular value decomposition with mapped singular values, σ ↦ 1/σ, σ, σ/(σ² + k²): damping adds k²
to each eigenvalue σ² of JJᵀ (slide 13). The pseudoinverse in the lecture needs full rank; here, following
Moore and Penrose, a singular value of zero remains zero.
"""

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import TOLERANCE, Array, matrix, spaces


def pseudoinverse(J: ArrayLike, tolerance: float = TOLERANCE) -> Array:
    """Return J⁺ (n, m), the Moore-Penrose inverse (slide 10).

    Raises:
        ValueError: if J is not a matrix of finite numbers.
    """
    parts = spaces(J, tolerance)
    inverse: Array = (parts.row_space / parts.sigma[: parts.rank]) @ parts.range.T
    return inverse


def weighted_pseudoinverse(J: ArrayLike, W_inv: ArrayLike, tolerance: float = TOLERANCE) -> Array:
    """Return J_w⁺ (n, m): of all q̇ with Jq̇ = ẋ, J_w⁺ẋ has the smallest q̇ᵀWq̇.

    With W⁻¹ = LLᵀ it is L(JL)⁺, which needs no full rank and allows infinite weights: a joint with a
    zero in W⁻¹ does not move.

    Args:
        J: (m, n).
        W_inv: W⁻¹, its diagonal (n,) ≥ 0, or a positive definite matrix (n, n).
        tolerance: singular values of JL below this share of the largest one are zero.

    Raises:
        ValueError: if W⁻¹ is neither, or J is not a matrix of finite numbers.
    """
    J = matrix(J)
    L = _root(np.asarray(W_inv, dtype=np.float64), J.shape[1])
    inverse: Array = L @ pseudoinverse(J @ L, tolerance)
    return inverse


def _root(W_inv: Array, n: int) -> Array:
    """Return an L with LLᵀ = W⁻¹."""
    if W_inv.shape == (n,) and np.isfinite(W_inv).all() and (W_inv >= 0.0).all():
        return np.diag(np.sqrt(W_inv))
    if W_inv.shape == (n, n):
        try:
            return np.asarray(np.linalg.cholesky(W_inv), dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise ValueError("expected a positive definite matrix W⁻¹") from error
    raise ValueError(f"expected W⁻¹ as {n} numbers ≥ 0, or a matrix {(n, n)}; got {W_inv.shape}: {W_inv}")


def damped_inverse(J: ArrayLike, k: float) -> Array:
    """Return J* = Jᵀ(JJᵀ + k²I)⁻¹ (n, m), the damped least-squares or singularity-robust inverse (slide 12).

    J*ẋ is the q̇ that minimises ‖Jq̇ − ẋ‖² + k²‖q̇‖².

    Args:
        J: (m, n).
        k: damping, > 0, in the unit of J.

    Raises:
        ValueError: if k is not positive, or J is not a matrix of finite numbers.
    """
    if not k > 0.0:
        raise ValueError(f"expected a damping k > 0, got {k}; without damping it is the pseudoinverse")
    U, sigma, Vt = np.linalg.svd(matrix(J), full_matrices=False)
    inverse: Array = (Vt.T * (sigma / (sigma * sigma + k * k))) @ U.T
    return inverse


def variable_damping(sigma_min: float, threshold: float, most: float) -> float:
    """Return the damping k for a smallest singular value: 0 from `threshold` up, `most` in a singularity.

        k² = (1 − (σ_min / ε)²) k_max²   for σ_min < ε, else 0

    Chiaverini, Siciliano, Egeland, "Review of the damped least-squares inverse kinematics with experiments on
    an industrial robot manipulator", IEEE Trans. Control Systems Technology 2 (1994). Far from singularities
    the task is followed exactly.

    Raises:
        ValueError: if ε or k_max is not positive.
    """
    if not (threshold > 0.0 and most > 0.0):
        raise ValueError(f"expected a positive threshold and damping, got {threshold} and {most}")
    share = min(max(sigma_min / threshold, 0.0), 1.0)
    return most * float(np.sqrt(1.0 - share * share))


def variably_damped_inverse(J: ArrayLike, threshold: float, most: float) -> Array:
    """Return the damped inverse with `variable_damping`, or the pseudoinverse if the damping is 0, (n, m)."""
    sigma = np.linalg.svd(matrix(J), compute_uv=False)
    k = variable_damping(float(sigma[-1]), threshold, most)
    return damped_inverse(J, k) if k > 0.0 else pseudoinverse(J)
