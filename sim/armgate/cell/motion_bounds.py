"""Bounds of the motion of bodies, valid for every position whose prismatic joints are within given limits.

A point of body b moves by its distance from the axis of joint j for each rad of j. To bound that distance,
walk the chain from b back to j. Seen from the parent of the body's own joint, the points of the body lie on
circles around that joint's axis (or on a segment along it), whose farthest distance has a closed form. From
there on, each joint may point the remaining offset in any direction, so the lengths of the offsets add up. Of
the first offset, which is fixed in the frame of j, only the component perpendicular to j's axis counts.
"""

import numpy as np
from numpy.typing import NDArray

from armgate.cell.model import ModelBody, RobotModel

Array = NDArray[np.float64]


def motion_bounds(model: RobotModel, lower: Array | None = None, upper: Array | None = None) -> Array:
    """Return R (bodies, n): largest motion of any point of body b per unit of joint j, m/rad or m/m.

    R is 0 if j does not move b, and 1 for a prismatic j. Of the limits, only the travel of prismatic joints
    behind revolute ones matters; ``lower`` and ``upper`` (n,) widen it for a robot outside its limits.
    """
    travel = _Travel(model, lower, upper)
    R = np.zeros((len(model.bodies), model.n))
    for b, body in enumerate(model.bodies):
        for j in map(int, np.flatnonzero(model.chain[b])):
            R[b, j] = 1.0 if _is_prismatic(model, j) else _reach(travel, body, j)
    return R


def bend_bounds(model: RobotModel, lower: Array | None = None, upper: Array | None = None) -> Array:
    """Return G (bodies, n, n): bounds of |∂²x/∂q_i∂q_j| for all points x of body b, at every q in the limits.

    With i nearer to the base, ∂²x/∂q_i∂q_j = ω_i × ∂x/∂q_j if i is revolute, so it is at most R[b, j]; it is
    0 if i is prismatic. The arguments are those of ``motion_bounds``.
    """
    R = motion_bounds(model, lower, upper)
    G = np.zeros((len(model.bodies), model.n, model.n))
    for b in range(len(model.bodies)):
        moving = [int(j) for j in np.flatnonzero(model.chain[b])]
        for i in moving:
            if not _is_prismatic(model, i):
                for j in moving[moving.index(i) :]:
                    G[b, i, j] = G[b, j, i] = R[b, j]
    return G


class _Travel:
    """Axes and offsets of the joints; the offset of a prismatic joint is given at both ends of its travel."""

    def __init__(self, model: RobotModel, lower: Array | None, upper: Array | None) -> None:
        self.model = model
        low = model.lower if lower is None else np.minimum(lower, model.lower)
        high = model.upper if upper is None else np.maximum(upper, model.upper)
        self.axes = [_axis(model, j) for j in range(model.n)]
        self.rotations, self.offsets = [], []
        for j in range(model.n):
            placement = model.pin_model.jointPlacements[j + 1]
            origin, direction = np.array(placement.translation), placement.rotation @ self.axes[j]
            ends = (low[j], high[j]) if _is_prismatic(model, j) else (0.0,)
            self.rotations.append(np.array(placement.rotation))
            self.offsets.append([origin + float(end) * direction for end in ends])


def _is_prismatic(model: RobotModel, joint: int) -> bool:
    return model.joints[joint].kind == "prismatic"


def _axis(model: RobotModel, joint: int) -> Array:
    """Return the joint's axis in its own frame, from pinocchio's motion subspace (linear, angular)."""
    subspace: Array = np.asarray(model.pin_model.joints[joint + 1].createData().S, dtype=np.float64).reshape(
        6
    )
    return subspace[:3] if _is_prismatic(model, joint) else subspace[3:]


def _reach(travel: _Travel, body: ModelBody, joint: int) -> float:
    """Return the farthest distance of a point of ``body`` from the axis of the revolute ``joint``, m."""
    axis = travel.axes[joint]
    across = np.eye(3) - np.outer(axis, axis)
    path = _path(travel.model, joint, body.joint)
    if not path:
        return _farthest(body, across)
    tail = _swung(travel, body, path[-1])
    if len(path) == 1:
        return min(tail, _longest(travel, path[0], across) + _farthest(body, np.eye(3)))
    between = sum(_longest(travel, k, np.eye(3)) for k in path[1:-1])
    return _longest(travel, path[0], across) + between + tail


def _path(model: RobotModel, joint: int, last: int) -> list[int]:
    """Return the joints behind ``joint`` up to ``last``, in this order."""
    path = []
    while last != joint:
        path.append(last)
        last = model.parents[last]
    return path[::-1]


def _longest(travel: _Travel, joint: int, projection: Array) -> float:
    """Return the length of the joint's offset in its parent joint's frame after a projection, m.

    Norms are convex, so the maximum over the travel is at one of its ends.
    """
    return max(float(np.linalg.norm(projection @ offset)) for offset in travel.offsets[joint])


def _farthest(body: ModelBody, projection: Array) -> float:
    """Return the farthest distance of the body's points from its joint's origin after a projection, m."""
    core = body.placement.apply(np.array(body.shape.core)) @ projection.T
    by_core = float(np.linalg.norm(core, axis=1).max()) + body.shape.core_radius
    by_ball = float(np.linalg.norm(projection @ body.placement.t)) + body.shape.bounding_radius
    return min(by_core, by_ball)


def _swung(travel: _Travel, body: ModelBody, joint: int) -> float:
    """Return the farthest distance of the points of a body on ``joint`` from its parent joint's origin, m.

    For p rotated about the unit axis a at the offset o:

        max |o + p(θ)|² = |o|² + |p|² + 2 (o·a p·a + |o⊥||p⊥|)
    """
    points = body.placement.apply(np.array(body.shape.core)) @ travel.rotations[joint].T
    if _is_prismatic(travel.model, joint):
        norms = [np.linalg.norm(points + offset, axis=1).max() for offset in travel.offsets[joint]]
        return float(max(norms)) + body.shape.core_radius
    (offset,), axis = travel.offsets[joint], travel.rotations[joint] @ travel.axes[joint]
    along_o, along_p = float(offset @ axis), points @ axis
    across_o = float(np.linalg.norm(offset - along_o * axis))
    across_p = np.linalg.norm(points - np.outer(along_p, axis), axis=1)
    farthest = float(np.hypot(along_o + along_p, across_o + across_p).max()) + body.shape.core_radius
    return min(farthest, float(np.linalg.norm(offset)) + _farthest(body, np.eye(3)))
