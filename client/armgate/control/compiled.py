"""Camera law in its compiled form, used if numba is installed (extra `fast`).

`kernels.py` holds the compiled functions; `law.py` and the modules that it uses hold the same formulas in
numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armgate.cell.compilation import available
from armgate.cell.model import RobotModel
from armgate.control.bounds import IncrementBounds
from armgate.control.chase import Aim, Chase, Chased, Motion
from armgate.control.gains import Gains
from armgate.control.integrate import Ended, Integration, Scheme
from armgate.control.law import CameraLaw, Goal, Scene
from armgate.control.leader import Leader
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres
from armgate.control.vectors import vector
from armgate.control.weights import Vector

Records = NDArray[np.void]
Packed = NDArray[np.uint8]

NOT_OURS = "expected a scene or goal made by this law"

_ENDED = (Ended.CONVERGED, Ended.BOUND, Ended.BUDGET)


def camera_law(model: RobotModel, frame: str, gains: Gains | None = None) -> CameraLaw:
    """Return the camera law, compiled if possible; both forms agree to rounding."""
    return CompiledLaw(model, frame, gains) if available() else CameraLaw(model, frame, gains)


def leader_of(model: RobotModel, tool: str, floor: float | None) -> Leader:
    """Return the leader, compiled if possible; both forms agree to rounding."""
    return CompiledLeader(model, tool, floor) if available() else Leader(model, tool, floor)


@cache
def prepare() -> None:
    """Compile all kernels, or load them from numba's cache: about 30 s the first time, then about 1 s.

    Call it before the first increment is due; the constructor of `CompiledLaw` calls it. It does nothing
    if numba is not installed.
    """
    if not available():
        return
    kernels = _kernels()
    joints, spheres, pairs, cameras, goals, obstacles = (
        np.zeros(1, dtype)
        for dtype in (
            kernels.JOINT, kernels.SPHERE, kernels.PAIR, kernels.CAMERA, kernels.GOAL, kernels.OBSTACLE
        )
    )  # fmt: skip
    joints["R"][:] = cameras["R"][:] = np.eye(3)
    joints["axis"], joints["parent"], cameras["fade"] = (0.0, 0.0, 1.0), -1, (0.1, 0.2)
    goals["p"] = 1.0
    q, packed = np.zeros(1), _pack((cameras, goals, joints, np.ones((3, 1)), spheres, pairs, obstacles))
    kernels.evaluate(q, packed)
    kernels.advance(q, 0.1, packed)
    kernels.integrate(q, q, q + 1.0, (0.1, 1, 0.3, 1e-6, 0.1, 1.0), packed)
    kernels.task(q, packed)
    kernels.induced(q, packed)
    kernels.survey(q, np.zeros((1, 3)), q, 0.0, packed)
    kernels.look(q, 0.0, 0.0, 1.0, 1.0, packed)
    kernels.watch(q, np.zeros((1, 3)), packed)
    rows, numbers = np.ones((kernels.DQ + 1, 1)), np.array([0.01, 0.1, 1.0, 0.3, 1e-6, 0.1, 1.0])
    kernels.chase(np.ones(8), rows, numbers, packed)


def _kernels() -> ModuleType:
    return import_module("armgate.control.kernels")  # imported only when needed: numba loads slowly


def _pack(parts: Sequence[NDArray[Any]]) -> Packed:
    """Return records of all kinds, one after the other, after a header with their offsets."""
    head = np.empty(1, _kernels().HEAD)
    head[0] = tuple(np.cumsum([head.nbytes, *(part.nbytes for part in parts)]))
    return np.concatenate([np.frombuffer(part.tobytes(), np.uint8) for part in (head, *parts)])


@dataclass(frozen=True, slots=True)
class PackedScene(Scene):
    """Scene in the form that the kernels take.

    Attributes:
        packed: the robot and the obstacles, with room for a goal.
    """

    packed: Packed


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedGoal(Goal):
    """Goal in the form that the kernels take.

    Attributes:
        packed: the scene's array with the goal in it, one argument of the kernels.
    """

    packed: Packed


class _WithKernels:
    """Base of compiled forms: copies and pickles lack the kernels, because a module cannot be pickled."""

    _kernels: ModuleType

    def _load(self) -> None:
        prepare()
        self._kernels = _kernels()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the kernels."""
        return {name: value for name, value in vars(self).items() if name != "_kernels"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, with the kernels of this process."""
        self.__dict__.update(state)
        self._load()


class CompiledLaw(_WithKernels, CameraLaw):
    """`CameraLaw` with compiled evaluations. Scenes and goals of the two classes are not interchangeable."""

    def __init__(
        self, model: RobotModel, frame: str, gains: Gains | None = None, spheres: Spheres | None = None
    ) -> None:
        super().__init__(model, frame, gains, spheres)
        self._load()
        self._own_parts = (
            self._pack_camera(), np.zeros(1, self._kernels.GOAL), self._pack_joints(), np.ones((3, model.n)),
            self._pack_spheres(), self._pack_pairs(),
        )  # fmt: skip
        # Arrays without a scene and a goal, by the number of obstacles.
        self._blank: dict[int, Packed] = {}
        self._alone = PackedScene(np.zeros(model.n), np.inf, np.inf, self._packed_with(0))

    def scene(self, obstacles: Obstacles, q: Vector) -> PackedScene:
        """Return a scene; see `CameraLaw.scene`."""
        packed, around = self._packed_with(len(obstacles.radii)), _own(q)
        floor = -np.inf if obstacles.floor is None else obstacles.floor
        centres, radii = _own(obstacles.centres), _own(obstacles.radii)
        gap, own_gap = self._kernels.survey(around, centres, radii, floor, packed)
        return PackedScene(around, gap, own_gap, packed)

    def goal(
        self,
        p: ArrayLike,
        distance: float,
        scene: Scene | None = None,
        *,
        emergency: bool = False,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        ways: Vector | None = None,
    ) -> PackedGoal:
        """Return a goal; see `CameraLaw.goal`."""
        target, moving = (vector(np.asarray(v, dtype=np.float64)) for v in (p, velocity))
        around = self._alone if scene is None else scene
        if not isinstance(around, PackedScene):
            raise TypeError(NOT_OURS)
        packed = around.packed.copy()
        record, rows = self._goal_in(packed)
        record["p"], record["velocity"], record["distance"] = target, moving, distance
        record["emergency"] = emergency
        if ways is not None:
            rows[1:] = ways
        return PackedGoal(target, distance, scene, emergency, moving, ways, packed=packed)

    def __call__(self, q: Vector, goal: Goal) -> Vector:
        """Return f(q, p, d_r); see `CameraLaw.__call__`."""
        # Written without helpers: this call is so short that each further function call would add 5 %.
        if not isinstance(goal, PackedGoal):
            raise TypeError(NOT_OURS)
        qd: Vector = np.array(q, dtype=np.float64)
        self._kernels.evaluate(qd, goal.packed)
        return qd

    def run(
        self, start: Vector, goal: Goal, reach: Vector, scheme: Scheme, origin: Vector | None = None
    ) -> Integration:
        """Run the on-line scheme; see `CameraLaw.run`."""
        q, steps, ended = self._kernels.integrate(
            _own(start),
            _own(start if origin is None else origin),
            _own(reach),
            scheme.numbers,
            _packed(goal),
        )
        return Integration(q, steps, _ENDED[ended])

    def step(self, q: Vector, h: float, goal: Goal) -> Vector:
        """Return one step; see `CameraLaw.step`."""
        end = _own(q)
        self._kernels.advance(end, h, _packed(goal))
        return end

    def task(self, q: Vector, goal: Goal) -> tuple[tuple[float, float], Vector]:
        """Return Ψ and ∂Ψ/∂q; see `CameraLaw.task`."""
        psi1, psi2, M = self._kernels.task(_own(q), _packed(goal))
        return (psi1, psi2), M[:2]

    def induced(self, q: Vector, goal: Goal, velocity: ArrayLike) -> Vector:
        """Return the induced joint velocity; see `CameraLaw.induced`."""
        moving = self.goal(goal.p, goal.distance, goal.scene, velocity=velocity, ways=goal.ways)
        qd: Vector = self._kernels.induced(_own(q), moving.packed)
        return qd

    def errors(self, q: Vector, p: ArrayLike, wanted: float) -> tuple[float, float]:
        """Return angle and distance error; see `CameraLaw.errors`."""
        x, y, z = np.asarray(p, dtype=np.float64).tolist()
        angle, distance = self._kernels.look(_own(q), x, y, z, wanted, self._alone.packed)
        return angle, distance

    def chase(self, bounds: IncrementBounds, period: float, scheme: Scheme) -> CompiledChase:
        """Return the increments towards the optimum of this law; see `Chase`."""
        return CompiledChase(self, bounds, period, scheme)

    def chased(self, aim: Vector, rows: Vector, numbers: Vector, scene: Scene) -> tuple[int, Ended, bool]:
        """Write the increment of `CompiledChase`; return the steps made, the end, and `Chased.bounded`."""
        if not isinstance(scene, PackedScene):
            raise TypeError(NOT_OURS)
        steps, ended, bounded = self._kernels.chase(aim, rows, numbers, scene.packed.copy())
        return steps, _ENDED[ended], bounded

    def _packed_with(self, count: int) -> Packed:
        """Return a new array with room for a scene of this many obstacles."""
        blank = self._blank.get(count)
        if blank is None:
            blank = _pack((*self._own_parts, np.zeros(count, self._kernels.OBSTACLE)))
            self._blank = {count: blank}
        return blank.copy()

    def _goal_in(self, packed: Packed) -> tuple[Records, Vector]:
        """Return the goal's record and its rows (3, n), as writable views."""
        head = packed[: self._kernels.HEAD.itemsize].view(self._kernels.HEAD)[0]
        goal, rows = packed[head["goals"] : head["joints"]], packed[head["rows"] : head["spheres"]]
        return goal.view(self._kernels.GOAL), rows.view(np.float64).reshape(3, -1)

    def _pack_joints(self) -> Records:
        weights, joints = self._weights, _joints(self.model)
        joints["slope"], joints["offset"] = weights.slope, weights.offset
        joints["strength"], joints["lever"] = weights.strength, self._arm.lever
        return joints

    def _pack_spheres(self) -> Records:
        base = self._own.base
        moving, fixed = _moving(self.spheres), np.zeros(len(base), self._kernels.SPHERE)
        moving["moves"], moving["sinks"] = self._arm.moves, self._arm.sinks
        fixed["joint"], fixed["centre"], fixed["radius"] = -1, base, self._own.base_radii
        return np.concatenate((moving, fixed))

    def _pack_pairs(self) -> Records:
        pairs = np.zeros(len(self._own.touching), self._kernels.PAIR)
        pairs["a"], pairs["b"], pairs["touching"] = self._own.a, self._own.b, self._own.touching
        return pairs

    def _pack_camera(self) -> Records:
        gains, placement = self.gains, self._arm.mount
        camera = np.zeros(1, self._kernels.CAMERA)
        camera[0]["R"], camera[0]["t"] = placement.rotation, placement.translation
        camera["joint"], camera["spin"] = self._arm.last, self._arm.spin
        camera["squared"], camera["always"] = self._weights.squared, gains.limits.always
        camera["fade"] = gains.roll_fade
        for name in (
            "task",
            "distance",
            "roll",
            "repulsion",
            "reach",
            "own_repulsion",
            "own_reach",
            "contact",
            "push",
        ):
            camera[name] = getattr(gains, name)
        return camera


class CompiledChase(Chase):
    """`Chase` of a compiled law, as one call of a kernel on arrays that are made once."""

    _law: CompiledLaw

    def __init__(self, law: CompiledLaw, bounds: IncrementBounds, period: float, scheme: Scheme) -> None:
        super().__init__(law, bounds, period, scheme)
        kernels = _kernels()
        self._aim = np.zeros(8)
        self._numbers = np.array([period, *scheme.numbers])
        self._rows = np.ones((kernels.DQ + 1, law.model.n))
        self._rows[kernels.STEP], self._rows[kernels.CHANGE] = bounds.step, bounds.change
        self._rows[kernels.FAR] = self._far

    def step(self, motion: Motion, aim: Aim) -> Chased:
        """Return the increment towards the optimum, as far as the bounds allow."""
        rows, bounds = self._rows, aim.bounds
        # In the order of `kernels.START`, … One by one: numpy would first make an array of them.
        rows[0], rows[1], rows[2] = motion
        rows[3], rows[4] = bounds.lower, bounds.upper
        rows[8:10] = 1.0 if aim.ways is None else aim.ways
        self._aim[:3], self._aim[3:6] = aim.focus, aim.velocity
        self._aim[6], self._aim[7] = aim.distance, aim.emergency
        steps, ended, bounded = self._law.chased(self._aim, rows, self._numbers, aim.scene)
        return Chased(rows[10].copy(), steps, ended, bounded)


class CompiledLeader(_WithKernels, Leader):
    """`Leader` with compiled kinematics."""

    def __init__(self, model: RobotModel, tool: str, floor: float | None) -> None:
        super().__init__(model, tool, floor)
        self._load()
        kernels, frame = self._kernels, np.zeros(1, self._kernels.CAMERA)
        placement, frame["joint"] = model.frame_placement(tool), model.frame_joint(tool)
        frame[0]["R"], frame[0]["t"] = placement.R, placement.t
        no_goal, no_rows = np.zeros(1, kernels.GOAL), np.zeros((3, model.n))
        pairs, obstacles = np.zeros(0, kernels.PAIR), np.zeros(0, kernels.OBSTACLE)
        self._packed = _pack(
            (frame, no_goal, _joints(model), no_rows, _moving(self._spheres), pairs, obstacles)
        )

    def _at(self, q: Vector) -> tuple[Vector, Obstacles]:
        centres = np.empty((len(self._spheres.radii), 3))
        tool = np.array(self._kernels.watch(_own(q), centres, self._packed))
        return tool, Obstacles(centres, self._spheres.radii, self._floor)


def _joints(model: RobotModel) -> Records:
    """Return the records of a robot's joints, without weights."""
    joints = np.zeros(model.n, _kernels().JOINT)
    for i, joint in enumerate(model.joints):
        placement = model.pin_model.jointPlacements[i + 1]
        subspace = np.asarray(model.pin_model.joints[i + 1].createData().S).reshape(6)
        slides = joint.kind == "prismatic"
        joints[i]["R"], joints[i]["t"] = placement.rotation, placement.translation
        joints[i]["axis"] = subspace[:3] if slides else subspace[3:]
        joints[i]["slides"], joints[i]["parent"] = slides, model.parents[i]
    return joints


def _moving(spheres: Spheres) -> Records:
    """Return the records of spheres that joints move."""
    k = len(spheres.radii)
    records = np.zeros(k, _kernels().SPHERE)
    records["joint"], records["radius"] = spheres.joints, spheres.radii
    records["centre"] = np.reshape([spheres.in_joint(i) for i in range(k)], (k, 3))
    return records


def _own(values: Vector) -> Vector:
    """Return a copy of the type for which the kernels are compiled: contiguous, writable, of floats."""
    return np.array(values, dtype=np.float64)


def _packed(goal: Goal) -> Packed:
    if not isinstance(goal, PackedGoal):
        raise TypeError(NOT_OURS)
    return goal.packed
