"""Rigid transforms as 4 × 4 matrices: rotation in the upper left, translation [m] in the last column."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def placement(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """Return the placement of an origin [m] and roll, pitch, yaw [rad]: R = Rz(yaw)·Ry(pitch)·Rx(roll)."""
    cr, cp, cy = np.cos(rpy)
    sr, sp, sy = np.sin(rpy)
    T = np.eye(4)
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = xyz
    return T


def from_quaternion(xyz: Sequence[float], xyzw: Sequence[float]) -> Array:
    """Return the placement of an origin [m] and a unit quaternion x, y, z, w."""
    x, y, z, w = xyzw
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = xyz
    return T


def roll_pitch_yaw(T: Array) -> tuple[float, float, float]:
    """Return the angles [rad] of a placement's rotation Rz(yaw)·Ry(pitch)·Rx(roll)."""
    R = T[:3, :3]
    level = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = float(np.arctan2(-R[2, 0], level))
    if level < 1e-9:  # only the sum or difference of roll and yaw matters
        return 0.0, pitch, float(np.arctan2(-R[0, 1], R[1, 1]))
    return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))


def skew(axis: Sequence[float]) -> Array:
    """Return the matrix K of the cross product: K·v = axis × v."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
