"""Motion along which ellipsoids are drawn: positions of one robot and the Jacobians there."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import UsageError
from armgate.apps.lead.path import read_path
from armgate.cell.cell import Cell, Robot
from armgate.cell.model import RobotModel
from armgate.control.redundancy.selfmotion import Ended, trace_self_motion
from armgate.control.redundancy.tasks import FrameTask

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
FLAT = 1e-9
"""Velocity along an axis, m per rad, up to which a frame counts as not moving along it."""


@dataclass(frozen=True)
class Motion:
    """Positions of a robot, in order.

    Attributes:
        title: Description of the motion for users.
        model: Model of the robot.
        frame: Frame whose ellipsoids are drawn.
        rows: Axes along which the frame moves: two for a planar arm.
        q: Positions, (k, n).
    """

    title: str
    model: RobotModel
    frame: str
    rows: tuple[str, ...]
    q: Array

    @property
    def task(self) -> FrameTask:
        """Translation of the frame along the rows."""
        return FrameTask(self.model, self.frame, self.rows)

    def pick(self, count: int) -> Array:
        """Return at most ``count`` positions (k, n), evenly spaced in joint space, including both ends.

        In a closed motion the last position equals the first and is left out.
        """
        steps = np.linalg.norm(np.diff(self.q, axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        closed = len(steps) > 1 and bool(np.linalg.norm(self.q[-1] - self.q[0]) < FLAT)
        wanted = np.linspace(0.0, way[-1], count, endpoint=not closed)
        picked: Array = self.q[np.unique(np.searchsorted(way, wanted - 1e-12))]
        return picked

    def skeleton(self, q: Array) -> Array:
        """Return points from the base over the joints to the frame, world, (k, 3), m.

        The rails of a gantry are left out: its arm begins at the last carriage.
        """
        joint, carriers = self.model.frame_joint(self.frame), []
        while joint >= 0:
            carriers.append(joint)
            joint = self.model.parents[joint]
        carriers.reverse()
        kinds = [self.model.joints[joint].kind for joint in carriers]
        rails = kinds.index("revolute") if "revolute" in kinds else 0
        links = {self.model.frame_joint(name): name for name in reversed(self.model.frame_names)}
        names = [*(links[joint] for joint in carriers[max(rails - 1, 0) :]), self.frame]
        points = [self.model.frame(q, name).t for name in names]
        return np.array(points if rails else [self.model.base.t, *points])


def motion_of(
    cell: Cell, name: str | None, frame: str | None, path: Path | None, *, self_motion: bool
) -> Motion:
    """Return the motion that the options describe.

    Raises:
        UsageError: Robot, frame and path do not fit each other, or there is no self-motion.
    """
    if path is not None and self_motion:
        raise UsageError("--path and --self-motion exclude each other; expected one of them")
    robot = _robot(cell, name)
    frame = frame or robot.tool
    if frame not in robot.model.frame_names or robot.model.frame_joint(frame) < 0:
        known = ", ".join(known for known in robot.model.frame_names if robot.model.frame_joint(known) >= 0)
        raise UsageError(f"robot {robot.name!r} has no moving frame {frame!r}; it has {known}")
    title = f"{robot.name} of {cell.name}, frame {frame}"
    rows = moving_rows(robot.model, frame)
    if path is not None:
        return Motion(f"{title}, along {path.name}", robot.model, frame, rows, _along(path, robot))
    start = np.array(robot.start)
    if not self_motion:
        return Motion(f"{title}, at the start", robot.model, frame, rows, start[None])
    q = both_ways(FrameTask(robot.model, frame, rows), start)
    return Motion(f"{title}, self-motion", robot.model, frame, rows, q)


def moving_rows(model: RobotModel, frame: str) -> tuple[str, ...]:
    """Return the axes along which the frame moves, from random positions within the joint limits."""
    rng = np.random.default_rng(0)
    some = [model.frame_jacobian(rng.uniform(model.lower, model.upper), frame)[:3] for _ in range(20)]
    reach = np.abs(some).max(axis=(0, 2))
    return tuple(axis for axis, length in zip(AXES, reach, strict=True) if length > FLAT)


def both_ways(task: FrameTask, start: Array) -> Array:
    """Return the self-motion through the start within the joint limits (k, n), as a closed or an open curve.

    Raises:
        UsageError: There is no self-motion.
    """
    try:
        there = trace_self_motion(task, start)
    except ValueError as error:
        raise UsageError(
            f"{error}; expected a robot with more joints than the {task.m} rows of the task"
        ) from error
    if there.ended is Ended.CLOSED or len(there.q) < 2:
        return there.q
    back = trace_self_motion(task, start, along=there.q[0] - there.q[1])
    return np.concatenate([back.q[:0:-1], there.q])


def _robot(cell: Cell, name: str | None) -> Robot:
    known = {robot.name: robot for robot in cell.robots}
    if name is None:
        return cell.robots[0]
    if name not in known:
        raise UsageError(f"cell {cell.name!r} has no robot {name!r}; it has {', '.join(known)}")
    return known[name]


def _along(path: Path, robot: Robot) -> Array:
    recorded = read_path(path)
    joints = tuple(joint.name for joint in robot.model.joints)
    if recorded.joints != joints:
        raise UsageError(
            f"{path}: is for joints {' '.join(recorded.joints)}; {robot.name} has {' '.join(joints)}"
        )
    return recorded.q
