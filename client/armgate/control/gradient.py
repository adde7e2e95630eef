"""The weighted gradient law, equation (9), with its joint limit weights.

    q̇ = −k_p J_w⁺ Ψ + (I − J_w⁺ J_t) W⁻¹ F,     J_w⁺ = W⁻¹ J_tᵀ S⁻¹,     S = J_t W⁻¹ J_tᵀ                   (9), (7)

needs neither projector nor pseudoinverse written out: collecting terms, q̇ = W⁻¹ (F + J_tᵀ λ) with the two unknowns
λ = S⁻¹ (Ψ̇ − J_t W⁻¹ F) and the wanted Ψ̇ = −k_p Ψ.
"""

from __future__ import annotations

import numpy as np

from armgate.control.weights import Vector

# S is damped only where a weighted joint speed of 1 turns the view by less than this in the worst direction.
DAMPING = 0.02


def weighted_gradient(J_t: Vector, F: Vector, rate: tuple[float, float], w: Vector, gain: float) -> Vector:
    """q̇ of (9), rad/s.

    Args:
        J_t: the task Jacobian ∂Ψ/∂q, (2, n).
        F: the field of the sub-tasks, (n,).
        rate: the wanted Ψ̇, 1/s.
        w: the diagonal of W⁻¹, (n,), each in [0, 1].
        gain: (1 + ‖Ψ‖²)/2, by which Ψ is steeper than the angle. It makes the damping the same at all angles.

    S gets μ²I where its least eigenvalue is below (DAMPING · gain)², with μ² so that it is brought up to that:
    exact elsewhere, continuous, and bounded where the limits weigh the task away.
    """
    A = J_t * w
    S = A @ J_t.T
    b = A @ F
    (a11, a12), (_, a22) = S.tolist()
    b1, b2 = b.tolist()
    floor = (DAMPING * gain) ** 2
    least = 0.5 * (a11 + a22) - (0.25 * (a11 - a22) ** 2 + a12 * a12) ** 0.5
    if least < floor:
        a11, a22 = a11 + floor - least, a22 + floor - least
    det = a11 * a22 - a12 * a12
    c1, c2 = rate[0] - b1, rate[1] - b2
    multipliers = np.array(((a22 * c1 - a12 * c2) / det, (a11 * c2 - a12 * c1) / det))
    qd: Vector = w * F + multipliers @ A
    return qd


def approach_weighted_gradient(
    J_t: Vector, F: Vector, rate: tuple[float, float], x: Vector, w: Vector, gain: float
) -> Vector:
    """(9) with each joint's weight in force only while the joint approaches the limit it is nearer to.

    Which joints approach is a result of the law, so it is solved twice: with all joints free, then with those weighted
    that approach. Where weighting them makes others approach (rare), these join and it is solved again. As a joint's
    q̇ passes zero its weight does not matter, so the switch is continuous.

    Args:
        J_t: (2, n).
        F: (n,).
        rate: the wanted Ψ̇, 1/s.
        x: positions in the half range, (n,), `LimitWeights.position`.
        w: `LimitWeights.inverse` at x, (n,).
        gain: see `weighted_gradient`.
    """
    approaching = weighted_gradient(J_t, F, rate, np.ones_like(w), gain) * x > 0.0
    while True:
        qd = weighted_gradient(J_t, F, rate, np.where(approaching, w, 1.0), gain)
        more = (qd * x > 0.0) & ~approaching
        if not more.any():
            return qd
        approaching |= more
