"""Correction of the view for increments that differ from the path of the law.

Null-space motion is exact only along the integrated path (16). The view turns if an increment covers only a
part of the chord from the start to the end of this path, or if bounded accelerations change its direction. So
the task is solved again at the end of the increment. With the view vector

    v = θ Ψ / ‖Ψ‖,   θ = 2 arctan ‖Ψ‖,

consider the straight line from v at the start of the law's path to v at its end. The increment is corrected
if its view angle θ at its end is wider than at the nearest point of this line. So an approach may turn the
view in another direction as long as the angle falls, and a correct view stays correct. The angle is braked
like a joint, because no bounded correction could stop a view that turns past the target too fast.
"""

from __future__ import annotations

from math import atan, hypot, tan

import numpy as np

from armgate.control.shaping import braking_increment
from armgate.control.weights import Vector

V2 = tuple[float, float]

# Largest number of rounds; in each round more joints reach their bounds.
ROUNDS = 4
# Damping of the least squares, as a share of the trace of J_t diag(mobility) J_tᵀ: for tasks that the free
# joints hardly move.
DAMPING = 1e-6


# Share of the combined effect of all joints' acceleration bounds with which the angle is braked; the rest is
# for the limits of single joints. With 0.7, as for each joint, 1 of 80 approaches overshot the target; with
# 0.35, 0 of 160.
RESERVE = 0.35


def view_vector(psi: V2) -> V2:
    """Return the view vector, (2), rad, of Ψ."""
    rho = hypot(*psi)
    scale = 2.0 if rho < 1e-9 else 2.0 * atan(rho) / rho
    return scale * psi[0], scale * psi[1]


def projection(v: V2) -> V2:
    """Return Ψ (2) of a view vector: the inverse of `view_vector`."""
    theta = hypot(*v)
    scale = 0.5 if theta < 1e-9 else tan(0.5 * theta) / theta
    return scale * v[0], scale * v[1]


def slowed(dq: Vector, induced: Vector, psi: V2, J_t: Vector, change: Vector) -> Vector:
    """Return the increment shortened towards `induced`, so that the angle can come to rest at zero.

    Args:
        dq: the increment, (n,).
        induced: the part of it that the target's own motion requires.
        psi: Ψ at the start, (2).
        J_t: ∂Ψ/∂q there, (2, n).
        change: bounds on the change of the increment per tick.
    """
    rho = hypot(*psi)
    if rho < 1e-4:
        return dq
    slope = (2.0 / ((1.0 + rho * rho) * rho)) * (psi[0] * J_t[0] + psi[1] * J_t[1])  # ∂θ/∂q
    shed = RESERVE * float(np.linalg.norm(slope * change))
    falls = -float(slope @ (dq - induced))
    may = float(braking_increment(np.array(2.0 * atan(rho)), np.array(shed)))
    return dq if falls <= may else induced + (may / falls) * (dq - induced)


def drawn_in(v: V2, start: V2, end: V2) -> V2:
    """Return v with its angle no wider than at the nearest point of the line from `start` to `end`."""
    way = end[0] - start[0], end[1] - start[1]
    length_squared = way[0] ** 2 + way[1] ** 2
    share = 1.0
    if length_squared > 0.0:
        share = ((v[0] - start[0]) * way[0] + (v[1] - start[1]) * way[1]) / length_squared
        share = min(max(share, 0.0), 1.0)
    widest = hypot(start[0] + share * way[0], start[1] + share * way[1])
    angle = hypot(*v)
    scale = 1.0 if angle <= widest else widest / angle
    return scale * v[0], scale * v[1]


def corrected(dq: Vector, missing: V2, J_t: Vector, low: Vector, high: Vector) -> Vector:
    """Return the increment in [`low`, `high`], near `dq`, that changes Ψ by `missing` more than `dq`.

    Least squares, with joints weighted by their room; joints at their bounds are left out and the others take
    over their part. If all joints together cannot reach the change, the result is as near to it as possible.

    Args:
        dq: within the bounds, (n,).
        missing: the change of Ψ, (2).
        J_t: ∂Ψ/∂q at dq, (2, n).
        low: lower bounds of the increment, (n,).
        high: upper bounds of the increment, (n,).
    """
    mobility, e = (high - low) ** 2, np.array(missing)
    floor = DAMPING * float((J_t * J_t * mobility).sum()) * np.eye(2)
    if not floor.any():
        return dq
    for _ in range(ROUNDS):
        A = J_t * mobility
        u = np.clip(dq + np.linalg.solve(A @ J_t.T + floor, e) @ A, low, high)
        e -= J_t @ (u - dq)
        free = (u > low) & (u < high)
        dq, mobility = u, np.where(free, mobility, 0.0)
        if not free.any() or float(np.abs(e).max()) < 1e-12:
            break
    return dq
