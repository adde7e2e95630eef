"""Near bodies: limits on the end of the stop that keep joints from approaching a near body further.

The gate admits an increment if the whole stop after it keeps its distance. So near a body the increments must
be chosen by the end of their stop. The limits apply to the end of the stop, joint by joint, for one tick. A
joint whose motion does not clearly lead away may end no further than the current stop, which the gate has
proven, plus its share of the remaining room. Far from other bodies these limits lie beyond the joint limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armgate.cell.model import RobotModel
from armgate.control.weights import Vector

# Part of the remaining room that is not used, m: directions change during the stop.
RESERVE = 0.01
# A joint clearly leads away if it opens the distance by this share of the distance that it moves the body.
AWAY = 0.2
# Joints that move the body by less than this, m/rad or m/m, are ignored.
STILL = 1e-3


@dataclass(frozen=True, slots=True)
class NearPair:
    """Pair of a body of the robot and another body, at the measured positions.

    Attributes:
        points: witness points of the robot's body and of the other one, (2, 3), world, m.
        joint: joint that carries the robot's body.
        room: their distance, less the margin and the approach of the other body during its stop, m.
    """

    points: Vector
    joint: int
    room: float


def opening(model: RobotModel, q: Vector, pair: NearPair) -> tuple[Vector, Vector]:
    """Return the effect of joints on a pair's distance at q (n,), and on the robot's witness point.

    Returns:
        ∂d/∂q (n,), and the norm of ∂x/∂q for each joint, (n,), m per rad or m.
    """
    J = model.point_jacobian(q, pair.joint, pair.points[0])
    apart = pair.points[0] - pair.points[1]
    n = apart / max(float(np.linalg.norm(apart)), 1e-9)
    return n @ J, np.linalg.norm(J, axis=0)


def approach(model: RobotModel, body: int, q: Vector, end: Vector, point: Vector, to: Vector) -> float:
    """Return by how much a body approaches between q and the end of its stop, m; 0 if it moves away.

    Args:
        model: robot of the body.
        body: its index in `model.bodies`.
        q: measured, (n,).
        end: end of the stop, (n,).
        point: its witness point at q, (3,), world, m.
        to: the other witness point, (3,), world, m.
    """
    R, t = model.body_placements(q)
    local = R[body].T @ (point - t[body])
    R, t = model.body_placements(end)
    apart = to - point
    n = apart / max(float(np.linalg.norm(apart)), 1e-9)
    return max(0.0, float(n @ (R[body] @ local + t[body] - point)))


def limits_near_bodies(
    model: RobotModel, q: Vector, setpoint: Vector, stop_end: Vector, pairs: tuple[NearPair, ...]
) -> tuple[Vector, Vector]:
    """Return lower and upper limits (n,) for the end of the stop after the next increment.

    Args:
        model: this robot.
        q: measured, (n,).
        setpoint: its commanded position, (n,).
        stop_end: end of the current stop, (n,).
        pairs: near pairs.
    """
    lower, upper = np.full(model.n, -np.inf), np.full(model.n, np.inf)
    low, high = np.minimum(setpoint, stop_end), np.maximum(setpoint, stop_end)
    for pair in pairs:
        rate, lever = opening(model, q, pair)
        moving = lever > STILL
        room = pair.room - RESERVE + min(0.0, float(rate @ (stop_end - q)))
        more = max(room, 0.0) / (max(1, int(moving.sum())) * np.maximum(lever, STILL))
        upper = np.where(moving & (rate <= AWAY * lever), np.minimum(upper, high + more), upper)
        lower = np.where(moving & (-rate <= AWAY * lever), np.maximum(lower, low - more), lower)
    return lower, upper
