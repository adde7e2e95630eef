"""Camera law f(q, p, d_r) of (16): equations (9) to (15) combined for one robot.

`kernels.py` repeats these formulas for numba; `compiled.CompiledLaw` has the same interface on top of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.model import RobotModel
from armgate.control.bounds import IncrementBounds
from armgate.control.chase import Chase
from armgate.control.gains import Gains
from armgate.control.gradient import limited_gradient
from armgate.control.integrate import Integration, Scheme, integrate, rk4
from armgate.control.kinematics import CameraArm
from armgate.control.repulsion import Obstacles, Repulsion
from armgate.control.self_collision import OwnPairs
from armgate.control.spheres import Spheres
from armgate.control.stereographic import camera_error
from armgate.control.subtasks import distance_pull, roll_rate
from armgate.control.vectors import V3, dot, vector, wrench
from armgate.control.view_errors import view_errors
from armgate.control.weights import LimitWeights, Vector

# (m or rad)² per rad²: bounds `induced` if the view distance cannot be kept, for example with a straight
# elbow.
INDUCED_DAMPING = 1e-4


@dataclass(frozen=True, slots=True)
class Scene:
    """Obstacles, and their distances from the robot's spheres at one position.

    `CameraLaw` and `CompiledLaw` each use a subclass of their own.

    Attributes:
        around: this position, (n,).
        gap: smallest distance to an obstacle there, m; inf without obstacles.
        own_gap: smallest distance between own spheres that can meet, m.
    """

    around: Vector
    gap: float
    own_gap: float


@dataclass(frozen=True, slots=True)
class PushingScene(Scene):
    """Scene of `CameraLaw`.

    Attributes:
        repulsion: the forces (12).
    """

    repulsion: Repulsion


@dataclass(frozen=True, slots=True)
class Goal:
    """Goal of the law, constant during the evaluations for one increment.

    Attributes:
        p: the target, world, m.
        distance: d_r, the wanted view distance, m.
        scene: the obstacles; None for none.
        emergency: True to use (13) instead of (9).
        velocity: ṗ, m/s, for the term P ṗ of (4). Only a law that integrates real time may use it: in the
            virtual time of (16) the target stands still.
        ways: factors of the limit weights for motion down and up, (2, n), each in [0, 1]: 0 if a near body
            leaves the joint no room in this direction, 1 if it has its full room; None for 1 everywhere.
    """

    p: V3
    distance: float
    scene: Scene | None = None
    emergency: bool = False
    velocity: V3 = (0.0, 0.0, 0.0)
    ways: Vector | None = None


@dataclass(frozen=True, slots=True)
class Terms:
    """Terms of an evaluation at one q.

    Attributes:
        psi: Ψ, (2).
        J_t: ∂Ψ/∂q, (2, n).
        J_d: ∂‖x − p‖/∂q, (n,), m/rad.
        F: sum of the fields of view distance (14) and roll (15), (n,).
        F_rep: repulsion (12) from obstacles and from itself, (n,).
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
        """(1 + ‖Ψ‖²)/2 = dΨ/dθ: slope of Ψ over the angle."""
        return 0.5 * (1.0 + self.psi[0] ** 2 + self.psi[1] ** 2)


class CameraLaw:
    """Weighted gradient law for a camera at `frame` of `model`.

    The camera's frame has its origin in the lens, e3 along the view and e1 up in the picture. Its robot may
    have any number of joints; the roll (15) is that of the last joint that carries the camera. A law uses
    pinocchio's work space, so one object must not be used by two threads at once.

    Args:
        model: the follower.
        frame: name of the camera's frame.
        gains: see `Gains`.
        spheres: bounding spheres that repulsion acts on; by default those of all moving bodies.

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
        self._arm = CameraArm(model, frame, self.spheres)
        self._own = OwnPairs(model, self.spheres, self._arm.carriers)
        self._weights = LimitWeights.of(model, self.gains.limits, self.gains.limit)
        self._nothing = np.zeros(model.n)

    def scene(self, obstacles: Obstacles, q: Vector) -> Scene:
        """Return the scene with its distances at q, (n,); it is valid for evaluations at every position."""
        self._arm.place(q)
        repulsion = Repulsion(self.spheres.radii, self._arm.moves, self._arm.sinks, obstacles, self.gains)
        centres = self._arm.centres()
        return PushingScene(q, repulsion.least_gap(centres), self._own.least_gap(centres), repulsion)

    def goal(
        self,
        p: ArrayLike,
        distance: float,
        scene: Scene | None = None,
        *,
        emergency: bool = False,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        ways: Vector | None = None,
    ) -> Goal:
        """Return the goal for evaluations of the law.

        Args:
            p: the target, (3,), world, m.
            distance: d_r, m.
            scene: the obstacles; None for none.
            emergency: True to use (13) instead of (9).
            velocity: ṗ, (3,), m/s; see `Goal`.
            ways: (2, n); see `Goal`.
        """
        target, moving = (vector(np.asarray(v, dtype=np.float64)) for v in (p, velocity))
        return Goal(target, distance, scene, emergency, moving, ways)

    def __call__(self, q: Vector, goal: Goal) -> Vector:
        """Return f(q, p, d_r) of (16), (n,), rad/s."""
        terms = self.terms(q, goal)
        drift = _drift(terms, goal.velocity)
        return self.velocity(q, terms, emergency=goal.emergency, drift=drift, ways=goal.ways)

    def step(self, q: Vector, h: float, goal: Goal) -> Vector:
        """Return one step (16) of the Runge-Kutta method from q over h, s."""
        return rk4(lambda at: self(at, goal), q, h, self(q, goal))

    def run(
        self, start: Vector, goal: Goal, reach: Vector, scheme: Scheme, origin: Vector | None = None
    ) -> Integration:
        """Run the on-line scheme (16), (17) for this law; see `integrate`."""
        return integrate(lambda q: self(q, goal), start, reach, scheme, origin)

    def task(self, q: Vector, goal: Goal) -> tuple[tuple[float, float], Vector]:
        """Return Ψ (2) and ∂Ψ/∂q (2, n) at q."""
        terms = self.terms(q, goal)
        return terms.psi, terms.J_t

    def errors(self, q: Vector, p: ArrayLike, wanted: float) -> tuple[float, float]:
        """Return angle and distance error at q, (n,), for the target p, (3,), m; see `view_errors`."""
        return view_errors(self.model, self.frame, q, p, wanted)

    def chase(self, bounds: IncrementBounds, period: float, scheme: Scheme) -> Chase:
        """Return the increments towards the optimum of this law; see `Chase`."""
        return Chase(self, bounds, period, scheme)

    def terms(self, q: Vector, goal: Goal) -> Terms:
        """Return errors, Jacobians and fields at q, (n,).

        All forces and both rows of the task are wrenches at the world's origin, so that one product with
        the spatial Jacobian gives all joint forces at once.
        """
        arm, gains, p = self._arm, self.gains, goal.p
        arm.place(q)
        e1, e2, e3 = arm.camera_axes()
        x = arm.camera_point()
        psi, g1, g2, ray, distance = camera_error(e1, e2, e3, (p[0] - x[0], p[1] - x[1], p[2] - x[2]))
        # The minus signs: the target in the picture moves opposite to the camera, and the distance decreases
        # if the camera moves along the ray.
        rows = np.array((wrench(g1, p), wrench(g2, p), wrench(ray, x)))
        J = (rows @ arm.J) * -arm.camera_moved
        F = distance_pull(distance, goal.distance, gains.distance) * J[2]
        F[arm.last] += roll_rate(e1, e2, arm.spin, gains.roll_fade, gains.roll)
        return Terms(psi, J[:2], J[2], F, self._repulsion(q, goal.scene), (g1, g2), ray)

    def _repulsion(self, q: Vector, scene: Scene | None) -> Vector:
        """Return Jᵀ of the forces (12) at q, at which the arm is placed, (n,)."""
        if scene is None:
            return self._nothing
        if not isinstance(scene, PushingScene):
            raise TypeError("expected a scene made by this law")
        arm, F = self._arm, self._nothing
        # Usually nothing is within reach at the position of the scene, and the motion from there is too short
        # to change that.
        way = float(np.abs(q - scene.around) @ arm.lever)
        others, own = way >= scene.gap - self.gains.reach, way >= scene.own_gap - self.gains.own_reach
        if not (others or own):
            return F
        centres = arm.centres()
        if others and (pushed := scene.repulsion.wrenches(centres)) is not None:
            which, wrenches = pushed
            F = F + ((wrenches @ arm.J) * arm.spheres_moved[which]).sum(axis=0)
        if own and (force := self._own.force(centres, arm.J, self.gains)) is not None:
            F = F + force
        return F

    def velocity(
        self,
        q: Vector,
        terms: Terms,
        *,
        emergency: bool = False,
        drift: tuple[float, float] = (0.0, 0.0),
        ways: Vector | None = None,
    ) -> Vector:
        """Return q̇ of (9), or of (13) in an emergency, from the terms at q, (n,); `drift` is P ṗ of (4)."""
        down, up = self._directed(q, ways)
        if emergency:
            return np.where(terms.F_rep > 0.0, up, down) * terms.F_rep
        M = np.empty((3, len(q)))
        M[:2] = terms.J_t
        M[2] = terms.F + terms.F_rep
        k_p, (psi1, psi2) = self.gains.task, terms.psi
        rate = (-k_p * psi1 - drift[0], -k_p * psi2 - drift[1])
        return limited_gradient(M, rate, down, up, steepness=terms.steepness)

    def _directed(self, q: Vector, ways: Vector | None) -> tuple[Vector, Vector]:
        """Return W⁻¹ for joints that go down, and for those that go up, (n,)."""
        down, up = self._weights.directed(self._weights.position(q), always=self.gains.limits.always)
        return (down, up) if ways is None else (down * ways[0], up * ways[1])

    def induced(self, q: Vector, goal: Goal, velocity: ArrayLike) -> Vector:
        """Return the joint velocity, (n,), rad/s, that keeps angle and distance for a moving target.

        The target moves at `velocity` (3,), m/s. The result is the solution of J_t q̇ = −P ṗ (4) and
        J_d q̇ = −ray · ṗ with the least weighted norm. It is the expected motion of the optimum in real time;
        in the virtual time of (16) the term P ṗ of (4) would be wrong.
        """
        terms = self.terms(q, goal)
        v = vector(np.asarray(velocity, dtype=np.float64))
        slope, (drift1, drift2) = 1.0 / terms.steepness, _drift(terms, v)
        rate = (-slope * drift1, -slope * drift2, -dot(terms.ray, v))
        J = np.vstack((slope * terms.J_t, terms.J_d))
        A = J * np.minimum(*self._directed(q, goal.ways))
        qd: Vector = np.linalg.solve(A @ J.T + INDUCED_DAMPING * np.eye(3), rate) @ A
        return qd


def _drift(terms: Terms, velocity: V3) -> tuple[float, float]:
    """Return P ṗ of (4), 1/s."""
    return dot(terms.P[0], velocity), dot(terms.P[1], velocity)
