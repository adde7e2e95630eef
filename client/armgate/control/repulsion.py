"""Repulsion between bounding spheres, equation (12), and the switch to repulsion only, equation (13).

    F_rep = Σ J_oᵀ φ(d) n,      φ(d) = η (1/d − 1/ρ0) / d²,   d = ‖o − b‖ − r_o − r_b,   n = (o − b)/‖o − b‖

This is (12) with n/d² instead of the printed (o − b)/d³. For points both are equal; for spheres this form is
the negative gradient of the potential η/2 (1/d − 1/ρ0)². As printed, (12) changes sign with d and would pull
overlapping bodies together. So d is bounded below by a contact distance, and φ is bounded above.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.control.gains import Gains
from armgate.control.weights import Vector

_NO_CENTRES = np.zeros((0, 3))
_NO_RADII = np.zeros(0)


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Obstacles: spheres, and the floor as the plane z = floor.

    Attributes:
        centres: (m, 3), world, m.
        radii: (m,), m.
        floor: height of the floor, m; None without a floor.
    """

    centres: Vector = field(default_factory=lambda: _NO_CENTRES)
    radii: Vector = field(default_factory=lambda: _NO_RADII)
    floor: float | None = None

    def __post_init__(self) -> None:
        if self.centres.shape != (len(self.radii), 3):
            raise ValueError(
                f"expected one centre (m, 3) per radius (m,), got {self.centres.shape} and {self.radii.shape}"
            )


def push(d: Vector, eta: float, reach: float, gains: Gains) -> Vector:
    """Return φ(d) of (12) with η and ρ0: 0 beyond ρ0, finite at contact. d is the surfaces' distance, m."""
    d = np.maximum(d, gains.contact)
    strength: Vector = eta * (1.0 / d - 1.0 / reach) / (d * d)
    return np.clip(strength, 0.0, gains.push)


class Repulsion:
    """Forces of (12) on the spheres of a robot from given obstacles; made once per increment.

    Args:
        radii: radii of the robot's spheres, (k,), m.
        moves: True for spheres that a joint moves, (k,); the others cannot evade an obstacle.
        sinks: True for spheres whose height can change, (k,).
        obstacles: the obstacles.
        gains: see `Gains`.
    """

    def __init__(
        self,
        radii: Vector,
        moves: NDArray[np.bool_],
        sinks: NDArray[np.bool_],
        obstacles: Obstacles,
        gains: Gains,
    ) -> None:
        self._gains = gains
        self._centres = obstacles.centres
        touching = radii[:, None] + obstacles.radii
        self._touching = np.where(moves[:, None], touching, -np.inf)
        self._near_squared = np.where(moves[:, None], (touching + gains.reach) ** 2, 0.0)
        # Height of a centre at which its sphere rests on the floor.
        floor = -np.inf if obstacles.floor is None else obstacles.floor
        self._resting = np.where(sinks, radii + floor, -np.inf)

    def least_gap(self, centres: Vector) -> float:
        """Return the smallest distance of spheres at centres (k, 3) to an obstacle, m; inf without any."""
        apart = np.linalg.norm(centres[:, None] - self._centres, axis=2) - self._touching
        above = centres[:, 2] - self._resting
        return float(min(np.min(apart, initial=np.inf), np.min(above, initial=np.inf)))

    def wrenches(self, centres: Vector) -> tuple[NDArray[np.intp], Vector] | None:
        """Return the repelled spheres at centres (k, 3): indices (a,) and wrenches [f; o × f] (a, 6).

        A sphere has an entry per obstacle that repels it. The result is None if no obstacle repels any
        sphere, as is usual.
        """
        apart = centres[:, None] - self._centres
        squared = np.einsum("ijk,ijk->ij", apart, apart)
        near = squared < self._near_squared
        height = centres[:, 2] - self._resting
        low = height < self._gains.reach
        if not (near.any() or low.any()):
            return None
        i, j = near.nonzero()
        distance = np.maximum(np.sqrt(squared[i, j]), 1e-9)
        strength = self._push(distance - self._touching[i, j])
        (k,) = low.nonzero()
        up = np.zeros((len(k), 3))
        up[:, 2] = self._push(height[k])
        forces = np.concatenate((apart[i, j] * (strength / distance)[:, None], up))
        pushed = np.concatenate((i, k))
        return pushed, np.concatenate((forces, np.cross(centres[pushed], forces)), axis=1)

    def _push(self, d: Vector) -> Vector:
        return push(d, self._gains.repulsion, self._gains.reach, self._gains)


class Emergency:
    """Switch to (13), q̇ = W⁻¹ F_rep, instead of (9): on below one distance, off above a larger one."""

    def __init__(self, gains: Gains) -> None:
        if gains.emergency_off < gains.emergency_on:
            raise ValueError(
                f"expected emergency_off ≥ emergency_on, got {gains.emergency_off} and {gains.emergency_on} m"
            )
        self._gains = gains
        self.active = False

    def update(self, least_gap: float) -> bool:
        """Return True if the emergency mode is active at this smallest distance to an obstacle, m."""
        threshold = self._gains.emergency_off if self.active else self._gains.emergency_on
        self.active = least_gap < threshold
        return self.active
