"""The weighted gradient law, equation (9), with its joint limit weights.

    q̇ = −k_p J_w⁺ Ψ + (I − J_w⁺ J_t) W⁻¹ F,   J_w⁺ = W⁻¹ J_tᵀ S⁻¹,   S = J_t W⁻¹ J_tᵀ        (9), (7)

The law needs neither an explicit projector nor an explicit pseudoinverse. Collecting terms gives
q̇ = W⁻¹ (F + J_tᵀ λ), where λ = S⁻¹ (Ψ̇ − J_t W⁻¹ F) has two components and Ψ̇ = −k_p Ψ is the wanted rate.
With J_t and F stacked as M = [J_t; F], the single product M W⁻¹ Mᵀ contains both S and J_t W⁻¹ F, and
q̇ = [λ; 1]ᵀ M W⁻¹.
"""

from __future__ import annotations

import numpy as np

from armgate.control.weights import Vector

# S is damped only if a weighted joint speed of 1 turns the view by less than this in the worst direction.
DAMPING = 0.02


def weighted_gradient(M: Vector, rate: tuple[float, float], w: Vector, steepness: float) -> Vector:
    """Return q̇ of (9), (n,), rad/s.

    If the smallest eigenvalue of S is below (DAMPING · steepness)², a term μ²I is added to S that raises it
    to this value. So the result is exact otherwise, continuous, and bounded if the joint limits make the
    weights of the task small.

    Args:
        M: the task Jacobian ∂Ψ/∂q in the first two rows, the field F of the sub-tasks in the third, (3, n).
        rate: the wanted Ψ̇, 1/s.
        w: the diagonal of W⁻¹, (n,), each in [0, 1].
        steepness: dΨ/dθ = (1 + ‖Ψ‖²)/2. It makes the damping equal at all angles.
    """
    A = M * w
    (s11, s12, b1), (_, s22, b2), _ = (A @ M.T).tolist()
    least = 0.5 * (s11 + s22) - (0.25 * (s11 - s22) ** 2 + s12 * s12) ** 0.5
    missing = (DAMPING * steepness) ** 2 - least
    if missing > 0.0:
        s11, s22 = s11 + missing, s22 + missing
    det = s11 * s22 - s12 * s12
    c1, c2 = rate[0] - b1, rate[1] - b2
    qd: Vector = np.array(((s22 * c1 - s12 * c2) / det, (s11 * c2 - s12 * c1) / det, 1.0)) @ A
    return qd


def limited_gradient(
    M: Vector, rate: tuple[float, float], down: Vector, up: Vector, *, steepness: float
) -> Vector:
    """Return q̇ of (9) with weights by direction: near a limit only the motion towards it is weighted.

    The directions of the joints follow from the law, so it is solved first with the larger weight of each
    joint, then with the weights of the actual directions. If other joints then take a weighted direction
    (rare), it is solved again. At q̇ = 0 the weight of a joint has no effect, so the switch is continuous.

    Args:
        M: as in `weighted_gradient`.
        rate: as in `weighted_gradient`.
        down: the diagonal of W⁻¹ for joints that go down, (n,), each in [0, 1].
        up: the same for joints that go up.
        steepness: as in `weighted_gradient`.
    """
    w = np.maximum(down, up)
    while True:
        qd = weighted_gradient(M, rate, w, steepness)
        taken = np.where(qd > 0.0, up, np.where(qd < 0.0, down, w))
        if (taken >= w).all():
            return qd
        w = np.minimum(w, taken)
