"""Direction error of the camera by stereographic projection, equations (3) and (4).

With the camera's axes e1, e2, e3 (e3 points along the view) and the ray r = p − x to the target,

    y = [e1·r, e2·r, e3·r] / ‖r‖,        Ψ = [y1, y2] / (1 + y3)                                        (3)

‖Ψ‖ = tan(θ/2), θ being the angle between view axis and ray. With s = ‖r‖ + e3·r, so that Ψ_i = e_i·r / s,

    g_i = ∂Ψ_i/∂r = (e_i − Ψ_i (r/‖r‖ + e3)) / s

The rows of P = ∂Ψ/∂p in (4) are the g_i. If the camera moves by v and turns by ω, Ψ changes as if the
target p moved by −(v + ω × p) in front of a fixed camera. So J_t = ∂Ψ/∂q has the rows −[g_i; p × g_i]ᵀ J. All
are in world axes, and J is the camera's spatial Jacobian at the world's origin.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin
from typing import NamedTuple

from armgate.control.vectors import V3, dot, norm

# Within this angle of the exact antipode, rad, the error is computed at this angle. So Ψ and J_t stay finite.
# The antipode is an unstable equilibrium, from which all ways to the target are equally long: there the
# direction of e1 is chosen.
ANTIPODE_GUARD = 1e-4
# Distance from the lens below which a target has no direction, m: it counts as straight ahead.
LENS_GUARD = 1e-6


class CameraError(NamedTuple):
    """Error of the task for a camera pose and a target, in world axes.

    Attributes:
        psi: Ψ of (3), two components.
        g1: ∂Ψ_1/∂r, 1/m, the first row of P in (4).
        g2: ∂Ψ_2/∂r, 1/m, the second row.
        ray: unit vector from the lens to the target.
        distance: ‖r‖, m.
    """

    psi: tuple[float, float]
    g1: V3
    g2: V3
    ray: V3
    distance: float


def camera_error(e1: V3, e2: V3, e3: V3, r: V3) -> CameraError:
    """Return Ψ of (3) and its gradient of (4) for camera axes e1, e2, e3 and the ray r, m.

    The result is finite everywhere: at the antipode and with the target in the lens the guards above apply.
    """
    distance = norm(r)
    if distance < LENS_GUARD:
        return _error(e1, e2, e3, e3, LENS_GUARD)
    ray = (r[0] / distance, r[1] / distance, r[2] / distance)
    # θ ≈ π − hypot(y1, y2) behind the camera.
    if dot(e3, ray) < 0.0 and hypot(dot(e1, ray), dot(e2, ray)) < ANTIPODE_GUARD:
        ray = _beside_antipode(e1, e2, e3, ray)
    return _error(e1, e2, e3, ray, distance)


def _error(e1: V3, e2: V3, e3: V3, ray: V3, distance: float) -> CameraError:
    s = 1.0 + dot(e3, ray)
    psi1, psi2 = dot(e1, ray) / s, dot(e2, ray) / s
    h = (ray[0] + e3[0], ray[1] + e3[1], ray[2] + e3[2])
    scale = 1.0 / (s * distance)
    g1 = ((e1[0] - psi1 * h[0]) * scale, (e1[1] - psi1 * h[1]) * scale, (e1[2] - psi1 * h[2]) * scale)
    g2 = ((e2[0] - psi2 * h[0]) * scale, (e2[1] - psi2 * h[1]) * scale, (e2[2] - psi2 * h[2]) * scale)
    return CameraError((psi1, psi2), g1, g2, ray, distance)


def _beside_antipode(e1: V3, e2: V3, e3: V3, ray: V3) -> V3:
    y1, y2 = dot(e1, ray), dot(e2, ray)
    away = hypot(y1, y2)
    u1, u2 = (y1 / away, y2 / away) if away > 0.0 else (1.0, 0.0)
    a, b = sin(ANTIPODE_GUARD), cos(pi - ANTIPODE_GUARD)
    return (
        a * (u1 * e1[0] + u2 * e2[0]) + b * e3[0],
        a * (u1 * e1[1] + u2 * e2[1]) + b * e3[1],
        a * (u1 * e1[2] + u2 * e2[2]) + b * e3[2],
    )
