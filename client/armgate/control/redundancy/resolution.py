"""Redundancy resolution: a wanted joint velocity in the null space of a task (slides 38-40).

Of all q̇ that fulfil the task ẋ = Jq̇, take the one nearest to a wanted q̇₀:

    minimise  f(q̇) = ½ (q̇ − q̇₀)ᵀW(q̇ − q̇₀)   subject to   g(q̇) = Jq̇ − ẋ = 0.

With Lagrange multipliers λ, ∇f = λ∇g is W(q̇ − q̇₀) = Jᵀλ, so q̇ = q̇₀ + W⁻¹Jᵀλ. The constraint gives
JW⁻¹Jᵀλ = ẋ − Jq̇₀. Substituting λ, with J_w⁺ = W⁻¹Jᵀ(JW⁻¹Jᵀ)⁻¹:

    q̇ = J_w⁺(ẋ − Jq̇₀) + q̇₀ = J_w⁺ẋ + (I − J_w⁺J) q̇₀.

The second term is the wanted velocity, projected to the null space: it does not move the task.
"""

from numpy.typing import ArrayLike

from armgate.control.redundancy.inverses import pseudoinverse, weighted_pseudoinverse
from armgate.control.redundancy.spaces import TOLERANCE, Array, matrix, vector


def resolve(
    J: ArrayLike,
    xd: ArrayLike,
    wanted: ArrayLike,
    W_inv: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
) -> Array:
    """Return q̇ = J_w⁺ẋ + (I − J_w⁺J) q̇₀ (n,).

    If J is singular, the unreachable part of ẋ is left out.

    Args:
        J: (m, n).
        xd: ẋ, the task velocity, (m,).
        wanted: q̇₀ (n,).
        W_inv: W⁻¹, diagonal (n,) or matrix (n, n); the identity if None.
        tolerance: as in `spaces`.

    Raises:
        ValueError: if the shapes do not fit.
    """
    J = matrix(J)
    xd, wanted = vector(xd, J.shape[0], "ẋ"), vector(wanted, J.shape[1], "q̇₀")
    inverse = pseudoinverse(J, tolerance) if W_inv is None else weighted_pseudoinverse(J, W_inv, tolerance)
    qd: Array = wanted + inverse @ (xd - J @ wanted)
    return qd


def null_space_part(J: ArrayLike, wanted: ArrayLike, tolerance: float = TOLERANCE) -> Array:
    """Return (I − J⁺J) q̇₀ (n,), the part of the wanted velocity that does not move the task.

    The projector is always that of J⁺: with I − J*J of a damped inverse, or I − JJᵀ, q̇₀ would disturb the
    task.
    """
    J = matrix(J)
    return resolve(J, [0.0] * J.shape[0], wanted, tolerance=tolerance)
