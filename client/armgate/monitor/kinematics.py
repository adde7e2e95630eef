"""Kinematics: the frames of joints, and bounds of how far joints can move bodies.

A joint turns or slides about its axis k in its own frame: T = origin · exp(q), with exp(q) = [I + sin q·K +
(1 − cos q)·K², 0] (Rodrigues) or [I, q·k].
"""

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.model import CellBody, Robot
from armgate.monitor.transforms import Array, skew

_MARGIN = 1e-3


class Kinematics:
    """Frames of the joints of one robot in the world."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        K = np.array([skew(axis) for axis in robot.axes]).reshape(-1, 3, 3)
        turns = robot.revolute[:, None, None]
        self._K = np.where(turns, K, 0.0)
        self._K2 = np.where(turns, K @ K, 0.0)
        self._slides = np.where(robot.revolute[:, None], 0.0, robot.axes)
        self._order = _parents_first(robot.parents)

    def frames(self, poses: Array) -> Array:
        """Return the frames of all joints at poses (m, n): (m, n + 1, 4, 4); the last one is the world's."""
        m, n = poses.shape
        local = np.zeros((m, n, 4, 4))
        local[..., 3, 3] = 1.0
        sines, versines = np.sin(poses)[..., None, None], (1.0 - np.cos(poses))[..., None, None]
        local[..., :3, :3] = np.eye(3) + sines * self._K + versines * self._K2
        local[..., :3, 3] = poses[..., None] * self._slides
        local = self._robot.origins @ local
        found = np.empty((m, n + 1, 4, 4))
        found[:, n] = np.eye(4)
        for joint in self._order:
            parent = self._robot.parents[joint]
            found[:, joint] = local[:, joint] if parent < 0 else found[:, parent] @ local[:, joint]
        return found


def _parents_first(parents: tuple[int, ...]) -> list[int]:
    order: list[int] = []
    while len(order) < len(parents):
        order += [j for j, p in enumerate(parents) if j not in order and (p < 0 or p in order)]
    return order


class Reach:
    """Bounds of how far a joint's motion moves any point of a body, certified for all positions in a range.

    A revolute joint moves a point by at most its distance from the axis times the angle. That distance is at
    most the length of the chain to the body: the offsets between joints, the travel of prismatic joints in
    between, and the extent of the body. Offsets and extents along the axis do not count for the body or joint
    that the joint carries directly. A prismatic joint moves each point by the distance that it moves itself.

    Attributes:
        travel: Largest absolute positions for which the bounds hold, (n,).
        lever: Bound per body and joint, (bodies, n), m per rad or m per m; 0 if the joint does not move it.
    """

    def __init__(self, robot: Robot, bodies: list[CellBody]) -> None:
        self._robot, self._bodies = robot, bodies
        self._above = [_chain(robot, body.joint) for body in bodies]
        self.travel = np.maximum(np.abs(robot.lower), np.abs(robot.upper)) + _MARGIN
        self._fill()

    def covers(self, poses: Array) -> bool:
        """Return True if the bounds hold at these poses (m, n)."""
        beyond = (np.abs(poses) > self.travel) & ~self._robot.revolute
        return not bool(beyond.any())

    def extend(self, poses: Array) -> None:
        """Widen the range so that it contains these poses with a margin."""
        self.travel = np.maximum(self.travel, 1.5 * np.abs(poses).max(axis=0) + _MARGIN)
        self._fill()

    def _fill(self) -> None:
        self.lever = np.array([self._levers(i) for i in range(len(self._bodies))]).reshape(-1, self._robot.n)

    def _levers(self, index: int) -> Array:
        """Return the bounds of one body, from the joint that carries it down to the base."""
        robot, body = self._robot, self._bodies[index]
        levers = np.zeros(robot.n)
        beyond = 0.0
        below: int | None = None
        for joint in self._above[index]:
            if not robot.revolute[joint]:
                levers[joint] = 1.0
            elif below is None:
                levers[joint] = _across(body, robot.axes[joint])
            else:
                offset = robot.origins[below][:3, 3]
                along = float(offset @ robot.axes[joint])
                across = float(np.sqrt(max(float(offset @ offset) - along * along, 0.0)))
                levers[joint] = across + self._slide(below) + beyond
            if below is None:
                beyond = _extent(body)
            else:
                beyond += float(np.linalg.norm(robot.origins[below][:3, 3])) + self._slide(below)
            below = joint
        return levers

    def _slide(self, joint: int) -> float:
        return 0.0 if self._robot.revolute[joint] else float(self.travel[joint])


def _chain(robot: Robot, joint: int) -> list[int]:
    """Return the joints from this one to the base."""
    chain = []
    while joint >= 0:
        chain.append(joint)
        joint = robot.parents[joint]
    return chain


def moved_by(robot: Robot, bodies: list[CellBody]) -> NDArray[np.bool_]:
    """Return which joints move each body, (bodies, n)."""
    moved = np.zeros((len(bodies), robot.n), dtype=bool)
    for row, body in zip(moved, bodies, strict=True):
        row[_chain(robot, body.joint)] = True
    return moved


def _placed(body: CellBody) -> Array:
    return np.asarray(body.solid.points @ body.placement[:3, :3].T + body.placement[:3, 3])


def _extent(body: CellBody) -> float:
    """Return the distance of the farthest point from the origin of the joint, m."""
    solid = body.solid
    return float((np.linalg.norm(_placed(body), axis=1) + solid.discs).max()) + solid.radius


def _across(body: CellBody, axis: Array) -> float:
    """Return the distance of the farthest point from the axis of the joint, m."""
    points = _placed(body)
    points = points - np.outer(points @ axis, axis)
    return float((np.linalg.norm(points, axis=1) + body.solid.discs).max()) + body.solid.radius
