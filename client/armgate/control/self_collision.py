"""Repulsion of a robot from itself: (12) between bounding spheres of its own segments.

The paper checks each segment against the leader and the floor. A camera that turns far enough can also
collide with its own arm or base. For two own spheres a and b the potential U(d) of (12) depends only on the
joints between them, and

    F = −∂U/∂q = (J_a − J_b)ᵀ φ(d) n,      n = (o_a − o_b) / ‖o_a − o_b‖.

The two forces are opposite and act along one line, so as wrenches at the world's origin they are equal up to
the sign: one wrench, with a sign for each joint that carries only a or only b, and zero for joints that carry
both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armgate.cell.model import RobotModel
from armgate.control.gains import Gains
from armgate.control.repulsion import push
from armgate.control.spheres import Spheres
from armgate.control.weights import Vector

# Largest variation of a pair's distance over random positions, m, at which it counts as constant.
CONSTANT = 1e-3
POSITIONS = 16


class OwnPairs:
    """Pairs of own spheres whose distance can decrease, including the spheres of the base.

    Spheres on neighbouring joints overlap at the joint, like the bodies that they cover, and are left out, as
    are pairs whose distance no joint changes.

    Attributes:
        base: centres of the base's spheres, world, (m, 3), m.
        base_radii: their radii, (m,), m.
        a: index of the first sphere of each pair, (p,); indices of the base follow those of the moving
            spheres.
        b: index of the second sphere.
        touching: r_a + r_b, (p,), m.

    Args:
        model: the robot.
        spheres: its moving spheres.
        carriers: row j: 1.0 for joint j and the joints that carry it, (n, n).
    """

    def __init__(self, model: RobotModel, spheres: Spheres, carriers: Vector) -> None:
        middle = 0.5 * (model.lower + model.upper)
        fixed = Spheres.of_base(model)
        self.base, self.base_radii = fixed.centres(middle), fixed.radii
        moved = np.vstack((carriers[list(spheres.joints)], np.zeros((len(self.base), model.n))))
        radii = np.concatenate((spheres.radii, self.base_radii))
        a, b = np.triu_indices(len(radii), 1)
        far = np.abs(moved[a] - moved[b]).sum(axis=1) > 1.0
        a, b = a[far], b[far]
        rng = np.random.default_rng(0)
        some = model.lower + (model.upper - model.lower) * rng.uniform(size=(POSITIONS, model.n))
        apart = [self._apart(spheres.centres(q), a, b)[1] for q in some]
        meet = np.ptp(apart, axis=0) > CONSTANT
        self.a, self.b = a[meet], b[meet]
        self.touching: Vector = radii[self.a] + radii[self.b]
        self._signs: Vector = moved[self.a] - moved[self.b]

    def least_gap(self, centres: Vector) -> float:
        """Return the smallest distance of a pair, m, with sphere centres (k, 3), m; inf without pairs."""
        _, distance = self._apart(centres, self.a, self.b)
        return float(np.min(distance - self.touching, initial=np.inf))

    def force(self, centres: Vector, J: Vector, gains: Gains) -> Vector | None:
        """Return F, (n,), with the spatial Jacobian J (6, n) at centres (k, 3); None if no pair repels."""
        apart, distance = self._apart(centres, self.a, self.b)
        gap = distance - self.touching
        (near,) = np.nonzero(gap < gains.own_reach)
        if not len(near):
            return None
        strength = push(gap[near], gains.own_repulsion, gains.own_reach, gains)
        forces = apart[near] * (strength / np.maximum(distance[near], 1e-9))[:, None]
        places = self._all(centres)[self.a[near]]
        wrenches = np.concatenate((forces, np.cross(places, forces)), axis=1)
        F: Vector = ((wrenches @ J) * self._signs[near]).sum(axis=0)
        return F

    def _all(self, centres: Vector) -> Vector:
        return np.concatenate((centres, self.base))

    def _apart(self, centres: Vector, a: NDArray[np.intp], b: NDArray[np.intp]) -> tuple[Vector, Vector]:
        """Return o_a − o_b (p, 3) and its norm (p,)."""
        every = self._all(centres)
        apart = every[a] - every[b]
        return apart, np.linalg.norm(apart, axis=1)
