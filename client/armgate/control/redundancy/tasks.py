"""Tasks: rows of the Jacobians of frames, errors to a target, and derivatives of the rows.

Rows are those of the velocity [v; ω] of a frame: linear velocity of its origin, then angular, world axes.
"""

from collections.abc import Sequence
from math import atan2
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.control.redundancy.spaces import Array, matrix

ROWS = ("x", "y", "z", "rx", "ry", "rz")
"""Names of the six rows: velocity of the origin [m/s], angular velocity [rad/s], world axes."""

P = TypeVar("P")


class Task(Protocol[P]):
    """Interface of a task; P is the type of its poses.

    Attributes:
        model: The robot.
        m: Number of rows.
    """

    model: RobotModel
    m: int

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J (m, n) at q (n,)."""
        ...

    def jacobian_derivative(self, q: ArrayLike) -> Array:
        """Return ∂J/∂q (m, n, n), whose last index is that of the joint of the derivative."""
        ...

    def place(self, q: ArrayLike) -> P:
        """Return the pose of the task at q."""
        ...

    def error(self, q: ArrayLike, target: P) -> Array:
        """Return the error from the pose at q to the target (m,), m and rad."""
        ...


class FrameTask:
    """Rows of one frame's motion.

    Args:
        model: The robot.
        frame: Name of a frame of it.
        rows: Names from `ROWS`, or a matrix (m, 6) whose rows are linear combinations of them.

    With all three angular rows, or none, the error's derivative at the target is −J. Angular rows that omit
    directions (rx without ry and rz, on a robot that turns in space) are velocities without a corresponding
    pose; statements on errors and self-motions hold for them only on robots that cannot turn otherwise, such
    as a planar arm.

    Raises:
        ModelError: The model has no such frame.
        ValueError: A row has another name, or the matrix has another shape.
    """

    def __init__(self, model: RobotModel, frame: str, rows: Sequence[str] | Array) -> None:
        model.frame_joint(frame)  # raises for an unknown frame
        self.model = model
        self.frame = frame
        self._S = _selection(rows)
        self.m = len(self._S)

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J (m, n) at q (n,)."""
        J: Array = self._S @ self.model.frame_jacobian(q, self.frame)
        return J

    def jacobian_derivative(self, q: ArrayLike) -> Array:
        """Return ∂J/∂q (m, n, n), exact."""
        whole = frame_jacobian_derivative(self.model.frame_jacobian(q, self.frame))
        rows: Array = np.tensordot(self._S, whole, axes=1)
        return rows

    def place(self, q: ArrayLike) -> Placement:
        """Return the pose of the frame at q, in the world."""
        return self.model.frame(q, self.frame)

    def error(self, q: ArrayLike, target: Placement) -> Array:
        """Return the rows of [t* − t; log(R*Rᵀ)] (m,): displacement and rotation vector to the target."""
        here = self.place(q)
        way = np.concatenate([target.t - here.t, rotation_vector(target.R @ here.R.T)])
        rows: Array = self._S @ way
        return rows


def _selection(rows: Sequence[str] | Array) -> Array:
    if isinstance(rows, np.ndarray):
        S = matrix(rows)
        if S.shape[1] != len(ROWS):
            raise ValueError(f"expected rows of {len(ROWS)} numbers, got a matrix {S.shape}")
        return S
    unknown = [row for row in rows if row not in ROWS]
    if unknown or not rows or len(set(rows)) != len(rows):
        raise ValueError(f"rows {','.join(rows)!r}; expected some of {', '.join(ROWS)}, each at most once")
    return np.eye(len(ROWS))[[ROWS.index(row) for row in rows]]


class StackedTask:
    """Tasks of several frames of one robot, stacked by rows; its poses are tuples.

    Raises:
        ValueError: There is no task, or the tasks belong to different robots.
    """

    def __init__(self, tasks: Sequence[FrameTask]) -> None:
        if not tasks or any(task.model is not tasks[0].model for task in tasks):
            raise ValueError("expected one task or more, all of one robot model")
        self.model = tasks[0].model
        self.m = sum(task.m for task in tasks)
        self._tasks = tuple(tasks)

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J (m, n) at q (n,)."""
        return np.concatenate([task.jacobian(q) for task in self._tasks])

    def jacobian_derivative(self, q: ArrayLike) -> Array:
        """Return ∂J/∂q (m, n, n), exact."""
        return np.concatenate([task.jacobian_derivative(q) for task in self._tasks])

    def place(self, q: ArrayLike) -> tuple[Placement, ...]:
        """Return the poses of the frames at q, in the world."""
        return tuple(task.place(q) for task in self._tasks)

    def error(self, q: ArrayLike, target: tuple[Placement, ...]) -> Array:
        """Return the errors of the tasks, one after the other (m,)."""
        errors = [task.error(q, place) for task, place in zip(self._tasks, target, strict=True)]
        return np.concatenate(errors)


def frame_jacobian_derivative(J: Array) -> Array:
    """Return ∂J/∂q (6, n, n) of a frame's Jacobian J (6, n), rows as in `ROWS`, from J alone.

    Let joint i come before joint k on the way to the frame. Moving i turns all that k moves; moving k does
    not affect i:

        ∂²x/∂q_i∂q_k = ω_i × v_k,    ∂ω_k/∂q_i = ω_i × ω_k,    ∂ω_i/∂q_k = 0,

    v and ω being the columns of J: zero for joints that do not move the frame, ω zero for prismatic ones. The
    order of the columns must be that of the joints from the base, as it is in a `RobotModel`.
    """
    v, w = J[:3].T, J[3:].T
    n = len(v)
    before = np.tri(n, dtype=bool).T[:, :, None]  # [i, k]: i before k, or the same
    bend = np.where(before, np.cross(w[:, None], v[None]), 0.0)
    bend += np.where(before, 0.0, bend.transpose(1, 0, 2))
    turn = np.where(before.transpose(1, 0, 2), np.cross(w[None], w[:, None]), 0.0)
    return np.concatenate([bend, turn], axis=2).transpose(2, 0, 1)


def rotation_vector(R: Array) -> Array:
    """Return axis times angle (3,), rad, of a rotation matrix; the angle is in [0, π]."""
    x, y, z, w = Placement(R, np.zeros(3)).xyzw()
    v = np.array([x, y, z])
    s = float(np.linalg.norm(v))
    return v * (2.0 * atan2(s, w) / s) if s > 0.0 else v
