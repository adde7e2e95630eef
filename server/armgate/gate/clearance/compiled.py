"""Compiled form of the prefilter, for installations with numba (extra `fast`)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, Literal, assert_never

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armgate.cell.compilation import available
from armgate.cell.model import RobotModel
from armgate.gate.clearance.prefilter import Prefilter, RobotPairs
from armgate.gate.clearance.support import Cornered
from armgate.gate.clearance.swept import Array, Index, Space, Swept

Records = NDArray[np.void]
_STALE = -1
_ROWS = 8
"""Initial number of rows for the nodes that a robot holds."""


def prefilter_of(space: Space, pairs: Sequence[RobotPairs], compiled: bool | None) -> Prefilter:
    """Return the prefilter; both forms agree up to rounding errors.

    Args:
        space: The cell's bodies.
        pairs: The pairs of each robot.
        compiled: True for the compiled form, False for numpy, None for compiled if numba is installed.

    Raises:
        ImportError: The compiled form is requested and numba is not installed.
    """
    if compiled or (compiled is None and available()):
        return CompiledPrefilter(space, pairs)
    return Prefilter(space, pairs)


class CompiledPrefilter(Prefilter):
    """`Prefilter` with compiled slabs and kinematics.

    Attributes:
        cell: The cell in the kernels' form.
        own: Pairs of each robot in the kernels' form: bodies, growth and bend bounds.
    """

    def __init__(self, space: Space, pairs: Sequence[RobotPairs]) -> None:
        prepare()
        self.pairs = list(pairs)
        self._space = space
        self.cell = pack_cell(space)
        self.own = [_pack_pairs(own) for own in pairs]
        self._held: list[Sequence[Swept]] = [() for _ in space.cell.robots]
        bodies = len(space.cell.bodies)
        # Static bodies have one row and come after the robots; robots of unknown position have none.
        count = np.array([0] * len(self._held) + [1], dtype=np.int64)
        R, t = (np.repeat(x, _ROWS, axis=0) for x in (space.static.R, space.static.t))
        self._nodes = (R, t, np.zeros((_ROWS, bodies)), count)
        self._bodies = [len(r.model.bodies) for r in space.cell.robots]
        space.place_with(self._place)

    def replace(self, robot: int, own: RobotPairs) -> None:
        """Replace the motion bounds of a robot's pairs."""
        super().replace(robot, own)
        self.cell = (*self.cell[:4], *_bounds(self._space))
        self.own[robot] = _pack_pairs(own)

    def hold(self, robot: int, swept: Sequence[Swept]) -> None:
        """Store the held occupancies of a robot; they are written at the next query that needs them."""
        self._held[robot] = swept
        self._nodes[3][robot] = _STALE

    def _lowered(self, robot: int, step: Array | None, need: Array, bound: Array) -> tuple[Array, Index]:
        if step is None:
            return super()._lowered(robot, step, need, bound)
        lb, left = np.empty(len(bound)), np.empty(len(bound), np.intp)
        count = kernels().lower(self.own[robot][1], step, need, bound, lb, left)
        return lb, left[:count]

    def _slabs(self, robot: int, new: Swept, left: Index, n: Array) -> Array:
        lb, moves, asked = np.empty(len(left)), (robot, new.nodes, new.tube), (left, n)
        own, slabs = self.own[robot], kernels().slabs
        while (other := slabs(self.cell, self._nodes, own, moves, asked, lb)) >= 0:
            self._write(other)  # an open pair needs the rows of this robot, which are out of date
        return lb

    def _write(self, robot: int) -> None:
        swept, row = self._held[robot], 0
        self._make_room(sum(len(s.nodes) for s in swept))
        for s in swept:
            kernels().hold(self.cell, self._nodes, robot, row, s.nodes, s.tube)
            row += len(s.nodes)
        self._nodes[3][robot] = row

    def _make_room(self, rows: int) -> None:
        R, t, deviation, count = self._nodes
        if rows > len(t):
            R, t, deviation = (
                np.concatenate([x, np.repeat(x[-1:], rows, axis=0)]) for x in (R, t, deviation)
            )
            self._nodes = (R, t, deviation, count)

    def _place(self, robot: int, q: ArrayLike) -> tuple[Array, Array]:
        """Return the placements of a robot's bodies at q; a `Place`."""
        bodies = self._bodies[robot]
        R, t = np.empty((bodies, 3, 3)), np.empty((bodies, 3))
        kernels().place(self.cell, robot, np.array(q, dtype=np.float64), R, t)
        return R, t

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, after the kernels of this process are ready."""
        prepare()
        kernels()  # raises an ImportError without numba
        self.__dict__.update(state)


@cache
def prepare() -> None:
    """Compile all kernels (some seconds), or load them from numba's cache (less than a second).

    After this no call compiles: arguments of another type raise an error. The constructor of
    `CompiledPrefilter` calls it, so that no tick waits for a compiler. Without numba it does nothing.
    """
    if not available():
        return
    k = kernels()
    robots, joints, bodies = (np.zeros(1, dtype) for dtype in (k.ROBOT, k.JOINT, k.BODY))
    robots["joints"] = robots["bodies"] = 1
    joints[0]["R"][:] = np.eye(3)
    joints["parent"] = bodies["joint"] = bodies["corners"] = -1
    cell = (robots, joints, bodies, np.zeros((1, 1, 4)), np.zeros((1, 1)), np.zeros((1, 1, 1)))
    R, t, deviation = np.zeros((2, 1, 3, 3)), np.zeros((2, 1, 3)), np.zeros((2, 1))
    one, two = np.zeros(1), np.zeros((2, 1))
    own = (np.zeros(1, k.PAIR), two[:1], np.zeros((1, 1, 1)))
    held = (R, t, deviation, np.ones(2, dtype=np.int64))
    k.place(cell, 0, one, R[0], t[0])
    k.hold(cell, held, 0, 0, two, one)
    k.slabs(cell, held, own, (0, two, one), (np.zeros(1, np.intp), np.zeros((1, 3))), one)
    places, point = np.zeros(1, np.intp), np.zeros(3)
    k.follow(cell, 0, (one, one), (places, two), one, (R[0], t[0]))
    k.lower(two, one, one, one, one, places)
    poses, search = (R[0], t[0]), (one, np.zeros(1, np.bool_), one, places)
    pairs, kept = (own[0], places, one, 0), (np.zeros((1, 3)), np.full((1, 2, 3), np.nan))
    found = (one, np.zeros(2, np.intp), two[0], np.zeros(2, np.bool_), np.zeros((2, 6)))
    arguments = ((cell, poses), pairs, kept, search, found)
    for search_kernel in (k.begin, k.recall, k.end):
        search_kernel(*arguments)
    k.certify(*arguments, (0, one, 0.0, point, point, point))
    for compiled in (k.place, k.hold, k.slabs, k.lower, k.follow, k.begin, k.recall, k.certify, k.end):
        compiled.disable_compile()


@cache
def kernels() -> ModuleType:
    """Return the module of the kernels; it is imported only here, because importing numba takes a second."""
    return import_module("armgate.gate.clearance.kernels")


def pack_cell(space: Space) -> tuple[Any, ...]:
    """Return the cell in the kernels' form: robots, joints, bodies, corners, motion and bend bounds."""
    k, cell = kernels(), space.cell
    models = [r.model for r in cell.robots]
    robots = np.zeros(len(models), k.ROBOT)
    robots["joints"], robots["bodies"] = [m.n for m in models], [len(m.bodies) for m in models]
    robots["joint"][1:] = np.cumsum(robots["joints"])[:-1]
    robots["body"][1:] = np.cumsum(robots["bodies"])[:-1]
    joints = np.concatenate([_pack_joints(m) for m in models])
    return robots, joints, _pack_bodies(space), _corners(space), *_bounds(space)


def _bounds(space: Space) -> tuple[Array, Array]:
    """Return motion and bend bounds of all bodies, padded to the number of joints of the largest robot."""
    models = [r.model for r in space.cell.robots]
    bodies, widest, first = len(space.cell.bodies), max(m.n for m in models), 0
    motion, bend = np.zeros((bodies, widest)), np.zeros((bodies, widest, widest))
    for i, m in enumerate(models):
        mine, first = slice(first, first + len(m.bodies)), first + len(m.bodies)
        motion[mine, : m.n], bend[mine, : m.n, : m.n] = space.motion[i], space.bend[i]
    return motion, bend


def _pack_joints(model: RobotModel) -> Records:
    joints = np.zeros(model.n, kernels().JOINT)
    for i, joint in enumerate(model.joints):
        placement = model.pin_model.jointPlacements[i + 1]
        subspace = np.asarray(model.pin_model.joints[i + 1].createData().S).reshape(6)
        slides = _slides(joint.kind)
        joints[i]["R"], joints[i]["t"] = placement.rotation, placement.translation
        joints[i]["axis"] = subspace[:3] if slides else subspace[3:]
        joints[i]["slides"], joints[i]["parent"] = slides, model.parents[i]
    return joints


def _slides(kind: Literal["revolute", "prismatic"]) -> bool:
    match kind:
        case "revolute":
            return False
        case "prismatic":
            return True
        case _:
            assert_never(kind)


def _pack_bodies(space: Space) -> Records:
    cell = space.cell
    bodies = np.zeros(len(cell.bodies), kernels().BODY)
    for k, body in enumerate(cell.bodies):
        joint = -1 if body.robot is None else cell.robots[body.robot].model.bodies[body.index].joint
        bodies[k]["R"], bodies[k]["t"] = body.placement.R, body.placement.t
        bodies[k]["joint"] = joint
        bodies[k]["owner"] = len(cell.robots) if joint < 0 else body.robot
    bodies["row"] = space.rows.rows if isinstance(space.rows, Cornered) else space.rows
    bodies["corners"] = space.rows.body if isinstance(space.rows, Cornered) else -1
    return bodies


def _corners(space: Space) -> Array:
    return space.rows.corners if isinstance(space.rows, Cornered) else np.zeros((0, 1, 4))


def _pack_pairs(own: RobotPairs) -> tuple[Any, ...]:
    pairs = np.zeros(len(own.ids), kernels().PAIR)
    pairs["mine"], pairs["theirs"] = own.mine, own.theirs
    n = own.growth.shape[1]
    bend = np.zeros((0, n, n)) if own.chain is None else own.chain.bend
    return pairs, np.ascontiguousarray(own.growth), np.ascontiguousarray(bend)
