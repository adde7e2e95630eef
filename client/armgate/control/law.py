"""The camera law f(q, p, d_r) of (16): equations (9) to (15) put together for one robot."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from armgate.cell.errors import ModelError
from armgate.cell.model import RobotModel
from armgate.control.gains import Gains
from armgate.control.gradient import approach_weighted_gradient
from armgate.control.repulsion import Obstacles, Repulsion, gaps
from armgate.control.spheres import Spheres
from armgate.control.stereographic import camera_error
from armgate.control.subtasks import distance_force, roll_rate
from armgate.control.vectors import V3, dot, vector, wrench
from armgate.control.weights import LimitWeights, Vector


@dataclass(frozen=True, slots=True)
class Goal:
    """What the law is asked for, the same for all evaluations of one increment.

    Attributes:
        p: the target, world, m.
        distance: d_r, the wanted view distance, m.
        repulsion: the obstacles as the robot's spheres feel them.
        emergency: (13) instead of (9).
    """

    p: V3
    distance: float
    repulsion: Repulsion
    emergency: bool = False


@dataclass(frozen=True, slots=True)
class Terms:
    """What an evaluation at one q is made of.

    Attributes:
        psi: Ψ, (2).
        J_t: ∂Ψ/∂q, (2, n).
        J_d: ∂‖x − p‖/∂q, (n,), m/rad.
        F: the sum of the sub-tasks' fields without repulsion, (n,).
        F_rep: repulsion (12), (n,).
        P: ∂Ψ/∂p, (2, 3), 1/m.
        ray: unit vector from lens to target, (3).
    """

    psi: tuple[float, float]
    J_t: Vector
    J_d: Vector
    F: Vector
    F_rep: Vector
    P: tuple[V3, V3]
    ray: V3

    @property
    def steepness(self) -> float:
        """(1 + ‖Ψ‖²)/2 = dΨ/dθ: by how much Ψ is steeper than the angle."""
        return 0.5 * (1.0 + self.psi[0] ** 2 + self.psi[1] ** 2)


@dataclass(frozen=True, slots=True)
class _Views:
    """The arrays into which pinocchio writes; bound once, they stay live."""

    J: Vector
    camera_R: Vector
    camera_t: Vector
    spheres: list[Vector] = field(default_factory=list)


class CameraLaw:
    """The weighted gradient law for a camera at `frame` of `model`.

    The camera's frame has its origin in the lens, e3 along the view and e1 up in the picture. Its robot may have any
    number of joints; the roll (15) is that of the last joint that carries the camera.

    Args:
        model: the follower.
        frame: name of the camera's frame.
        gains: see `Gains`.
        spheres: the bounding spheres that repulsion acts on; by default those of all its moving bodies.

    Raises:
        ModelError: for a frame that the model does not have, or that no joint moves.
    """

    def __init__(
        self, model: RobotModel, frame: str, gains: Gains | None = None, spheres: Spheres | None = None
    ) -> None:
        self.model = model
        self.frame = frame
        self.gains = Gains() if gains is None else gains
        self.spheres = Spheres.of(model) if spheres is None else spheres
        self._weights = LimitWeights(model.lower, model.upper, self.gains.limit)
        self._last = model.frame_joint(frame)
        if self._last < 0:
            raise ModelError(f"the camera frame {frame!r} is fixed to the base; expected one that a joint moves")
        self._pin = model.pin_model.copy()
        self._views = self._bind()
        moved = _moved_by(model)
        self._camera_moved = np.tile(moved[self._last], (3, 1))
        self._sphere_moved = moved[list(self.spheres.joints)]
        self._spin = self._spin_of_last()

    def _bind(self) -> _Views:
        """Make each sphere a frame of our copy of the model, so that pinocchio places them all in one call."""
        joint_of = {joint.name: self._pin.getJointId(joint.name) for joint in self.model.joints}
        names = [joint.name for joint in self.model.joints]
        frames = [
            self._pin.addFrame(
                pin.Frame(
                    f"bounding sphere {k}",
                    joint_of[names[joint]],
                    0,
                    pin.SE3(np.eye(3), self.spheres.in_joint(k)),
                    pin.FrameType.OP_FRAME,
                )
            )
            for k, joint in enumerate(self.spheres.joints)
        ]
        self._data = self._pin.createData()
        camera = self._data.oMf[self._pin.getFrameId(self.frame)]
        return _Views(
            self._data.J, camera.rotation, camera.translation, [self._data.oMf[k].translation for k in frames]
        )

    def _spin_of_last(self) -> float:
        """∂φ/∂q of the last joint with φ of (15): −(its axis · e3), whatever the position."""
        self._place(pin.neutral(self._pin))
        axis = vector(self._views.J[3:, self._last])
        return -dot(axis, vector(self._views.camera_R[:, 2]))

    def _place(self, q: Vector) -> None:
        pin.computeJointJacobians(self._pin, self._data, q)
        pin.updateFramePlacements(self._pin, self._data)

    def goal(self, p: ArrayLike, distance: float, obstacles: Obstacles | None = None, emergency: bool = False) -> Goal:
        """What to evaluate the law for: target p (3,), m; wanted distance d_r, m; obstacles; (13) or (9)."""
        repulsion = Repulsion(self.spheres.radii, obstacles or Obstacles(), self.gains)
        return Goal(vector(np.asarray(p, dtype=np.float64)), distance, repulsion, emergency)

    def terms(self, q: Vector, goal: Goal) -> Terms:
        """Errors, Jacobians and fields at q, (n,).

        All forces and both rows of the task are wrenches at the world's origin, so that one product with the
        spatial Jacobian gives all joint forces at once.
        """
        self._place(q)
        views, gains = self._views, self.gains
        e1, e2, e3 = (vector(column) for column in views.camera_R.T.tolist())
        x = vector(views.camera_t.tolist())
        p = goal.p
        psi, g1, g2, ray, distance = camera_error(e1, e2, e3, (p[0] - x[0], p[1] - x[1], p[2] - x[2]))
        # The distance shrinks as the lens moves along the ray.
        rows = np.array((wrench(g1, p), wrench(g2, p), wrench(ray, x)))
        J_t1_t2_d = (rows @ views.J) * -self._camera_moved
        J_d = J_t1_t2_d[2]
        F = (gains.distance * (goal.distance - distance)) * J_d
        F[self._last] += roll_rate(e1, e2, self._spin, gains.roll_fade, gains.roll)
        return Terms(psi, J_t1_t2_d[:2], J_d, F, self._repulsion(goal), (g1, g2), ray)

    def _repulsion(self, goal: Goal) -> Vector:
        """Jᵀ of the forces (12) at the position placed last, (n,)."""
        if not self._views.spheres:
            return np.zeros(self.model.n)
        pushed = goal.repulsion.wrenches(np.array(self._views.spheres))
        if pushed is None:
            return np.zeros(self.model.n)
        which, wrenches = pushed
        F: Vector = ((wrenches @ self._views.J) * self._sphere_moved[which]).sum(axis=0)
        return F

    def velocity(self, q: Vector, terms: Terms, emergency: bool = False) -> Vector:
        """q̇ of (9), or of (13) in an emergency, from the terms at q, (n,), rad/s."""
        x = self._weights.position(q)
        w = self._weights.inverse(x)
        if emergency:
            return np.where(terms.F_rep * x > 0.0, w, 1.0) * terms.F_rep
        k_p, psi = self.gains.task, terms.psi
        rate = (-k_p * psi[0], -k_p * psi[1])
        return approach_weighted_gradient(terms.J_t, terms.F + terms.F_rep, rate, x, w, terms.steepness)

    def __call__(self, q: Vector, goal: Goal) -> Vector:
        """f(q, p, d_r) of (16), (n,), rad/s."""
        return self.velocity(q, self.terms(q, goal), goal.emergency)

    def induced(self, q: Vector, goal: Goal, velocity: ArrayLike) -> Vector:
        """The joint velocity that keeps angle and distance while the target moves at `velocity` (3,), m/s.

        The weighted least one with J_t q̇ = −P ṗ (4) and J_d q̇ = −ray · ṗ; (n,), rad/s. For looking ahead a tick or
        so: put into the virtual time of (16), the term P ṗ of (4) does harm.
        """
        terms = self.terms(q, goal)
        v = vector(np.asarray(velocity, dtype=np.float64))
        J = np.vstack((terms.J_t / terms.steepness, terms.J_d))
        rate = [-dot(terms.P[0], v) / terms.steepness, -dot(terms.P[1], v) / terms.steepness, -dot(terms.ray, v)]
        JW = J * self._weights.inverse(self._weights.position(q))
        qd: Vector = np.linalg.solve(JW @ J.T + 1e-4 * np.eye(3), rate) @ JW
        return qd

    def least_gap(self, q: Vector, obstacles: Obstacles) -> float:
        """The least distance between a bounding sphere of the robot and an obstacle sphere at q, m (inf: none)."""
        centres = self.spheres.centres(q)
        return float(np.min(gaps(centres, self.spheres.radii, obstacles), initial=np.inf))


def _moved_by(model: RobotModel) -> Vector:
    """Row j: 1.0 for joint j and the joints that carry it, (n, n)."""
    moved = np.eye(model.n)
    for joint, parent in enumerate(model.parents):
        if parent >= 0:
            moved[joint] += moved[parent]
    return moved
