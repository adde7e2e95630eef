"""How far bodies can move: bounds that hold at every position within the limits, computed once.

Take a body b and a revolute joint j that moves it. A point of b moves by its distance from j's axis per rad. Seen
from j's frame the next frame of the chain is at a fixed offset (or, behind a prismatic joint, on a segment), of which
only the part across the axis counts; behind that any joint may turn the rest anywhere, so offsets add up as lengths,
and at the end stands the point of b that is farthest from its own joint's origin.
"""

import numpy as np
from numpy.typing import NDArray

from armgate.cell.model import ModelBody, RobotModel

Array = NDArray[np.float64]


def motion_bounds(model: RobotModel, lower: Array | None = None, upper: Array | None = None) -> Array:
    """R (bodies, n): the farthest that any point of body b can move per unit of joint j, m/rad or m/m.

    0 where j does not move b, 1 for prismatic j. Only the travel of prismatic joints behind revolute ones enters
    from the limits; ``lower`` and ``upper`` (n,) replace the URDF's, for a robot that starts outside of them.
    """
    low = model.lower if lower is None else np.minimum(lower, model.lower)
    high = model.upper if upper is None else np.maximum(upper, model.upper)
    R = np.zeros((len(model.bodies), model.n))
    for b, body in enumerate(model.bodies):
        for j in np.flatnonzero(model.chain[b]):
            R[b, j] = 1.0 if _is_prismatic(model, j) else _reach(model, body, int(j), low, high)
    return R


def bend_bounds(model: RobotModel, lower: Array | None = None, upper: Array | None = None) -> Array:
    """G (bodies, n, n): a bound of |∂²x/∂q_i∂q_j| for every point x of body b, at every q within the limits.

    With i the one nearer to the base: ∂²x/∂q_i∂q_j = ω_i × ∂x/∂q_j if i is revolute, so at most R[b, j]; 0 if i is
    prismatic. Arguments as in ``motion_bounds``.
    """
    R = motion_bounds(model, lower, upper)
    G = np.zeros((len(model.bodies), model.n, model.n))
    for b in range(len(model.bodies)):
        moving = np.flatnonzero(model.chain[b])
        for i in moving:
            if _is_prismatic(model, i):
                continue
            for j in moving[moving >= i]:
                G[b, i, j] = G[b, j, i] = R[b, j]
    return G


def _is_prismatic(model: RobotModel, joint: int) -> bool:
    return model.joints[joint].kind == "prismatic"


def _reach(model: RobotModel, body: ModelBody, joint: int, low: Array, high: Array) -> float:
    """Farthest distance of a point of ``body`` from the axis of the revolute ``joint``, m."""
    across = np.eye(3) - np.outer(axis := _axis(model, joint), axis)
    path = _path(model, joint, body.joint)
    if not path:
        return _farthest(body, across)
    first = max(float(np.linalg.norm(across @ offset)) for offset in _offsets(model, path[0], low, high))
    rest = sum(
        max(float(np.linalg.norm(offset)) for offset in _offsets(model, k, low, high)) for k in path[1:]
    )
    return first + rest + _farthest(body, np.eye(3))


def _path(model: RobotModel, joint: int, last: int) -> list[int]:
    """The joints behind ``joint`` up to ``last``, in this order."""
    path = []
    while last != joint:
        path.append(last)
        last = model.parents[last]
    return path[::-1]


def _axis(model: RobotModel, joint: int) -> Array:
    """The joint's axis in its own frame: what its unit speed moves, by pinocchio's motion subspace."""
    data = model.pin_model.joints[joint + 1].createData()
    subspace = np.asarray(data.S).reshape(6)
    return subspace[3:] if model.joints[joint].kind == "revolute" else subspace[:3]


def _offsets(model: RobotModel, joint: int, low: Array, high: Array) -> list[Array]:
    """Ends of the segment on which the joint's frame lies in its parent joint's frame (norms are convex on it)."""
    placement = model.pin_model.jointPlacements[joint + 1]
    origin = np.array(placement.translation)
    if not _is_prismatic(model, joint):
        return [origin]
    direction = placement.rotation @ _axis(model, joint)
    return [origin + float(value) * direction for value in (low[joint], high[joint])]


def _farthest(body: ModelBody, projection: Array) -> float:
    """Farthest distance of the body's points from its joint's origin, after a projection, m."""
    core = body.placement.apply(np.array(body.shape.core)) @ projection.T
    by_core = float(np.linalg.norm(core, axis=1).max()) + body.shape.core_radius
    by_ball = float(np.linalg.norm(projection @ body.placement.t)) + body.shape.bounding_radius
    return min(by_core, by_ball)
