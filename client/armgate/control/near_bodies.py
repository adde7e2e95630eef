"""Beside something: where a body is near another, joints do not bring it nearer than they are about to.

The gate admits an increment if the whole stop after it keeps its distance. So near a body the increments have
to be chosen by where their stop ends. What is allowed there is told joint by joint, as limits for the end of
the stop that hold for one tick: a joint that does not clearly lead away ends within the stop that is held
already, which the gate has proven, or goes farther by its share of the room that is left. Where bodies are
far apart these limits are beyond the joint's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armgate.cell.model import RobotModel
from armgate.control.weights import Vector

# Of the room that is left so much is not used, m: directions change on the way to rest.
RESERVE = 0.01
# A joint leads clearly away if it opens the distance by this share of the way that it moves the body.
AWAY = 0.2
# Joints that move the body by less than this, m/rad or m/m, do not matter.
STILL = 1e-3


@dataclass(frozen=True, slots=True)
class NearPair:
    """A body of the robot and one of another that are kept apart, at the measured positions.

    Attributes:
        points: the nearest points of both, ours and the other one, (2, 3), world, m.
        joint: the joint that carries our body.
        room: their distance less what must be kept, and less what the other one is about to take, m.
    """

    points: Vector
    joint: int
    room: float


def opening(model: RobotModel, q: Vector, pair: NearPair) -> tuple[Vector, Vector]:
    """How joints change the distance of a pair at q (n,), and how far they move our point at all.

    Returns:
        ∂d/∂q (n,), and the length of ∂x/∂q for each joint, (n,), m per rad or m.
    """
    J = model.point_jacobian(q, pair.joint, pair.points[0])
    apart = pair.points[0] - pair.points[1]
    n = apart / max(float(np.linalg.norm(apart)), 1e-9)
    return n @ J, np.linalg.norm(J, axis=0)


def approach(model: RobotModel, body: int, q: Vector, end: Vector, point: Vector, to: Vector) -> float:
    """How much nearer a body comes between q and the end of its stop, m; 0 where it goes away.

    Args:
        model: the robot that it belongs to.
        body: its index in `model.bodies`.
        q: measured, (n,).
        end: where the stop ends, (n,).
        point: its nearest point at q, (3,), world, m.
        to: the point to which it is near, (3,), world, m.
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
    """Limits, lower and upper (n,), for where the stop after the next increment ends.

    Args:
        model: this robot.
        q: measured, (n,).
        setpoint: its commanded position, (n,).
        stop_end: where the stop that is held ends, (n,).
        pairs: what is near.
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
