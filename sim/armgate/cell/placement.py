"""Rigid placements (SE(3)) for code that cannot use pinocchio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _frozen(values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"expected an array of shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def rotation_from_rpy(rpy: Sequence[float]) -> Array:
    """Return the rotation matrix (3, 3) of URDF's roll, pitch, yaw [rad]: ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@dataclass(frozen=True, eq=False)
class Placement:
    """Placement of a frame B in a frame A: ``x_A = R x_B + t``.

    Attributes:
        R: Rotation matrix, (3, 3), read-only.
        t: Origin of B in A, (3,), m, read-only.
    """

    R: Array
    t: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "R", _frozen(self.R, (3, 3)))
        object.__setattr__(self, "t", _frozen(self.t, (3,)))

    @classmethod
    def identity(cls) -> "Placement":
        """Return the identity."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rpy(cls, xyz: Sequence[float], rpy: Sequence[float]) -> "Placement":
        """Return the placement with an origin [m] and URDF's roll, pitch, yaw [rad]."""
        return cls(rotation_from_rpy(rpy), np.asarray(xyz, dtype=np.float64))

    @classmethod
    def from_quaternion(cls, xyz: Sequence[float], xyzw: Sequence[float]) -> "Placement":
        """Return the placement with an origin [m] and a quaternion (x, y, z, w) of any length but zero.

        Raises:
            ValueError: The quaternion is zero or not finite.
        """
        norm = float(np.linalg.norm(xyzw))
        if not np.isfinite(norm) or norm < 1e-12:
            raise ValueError(f"expected a finite quaternion other than zero, got {tuple(xyzw)}")
        x, y, z, w = (float(c) / norm for c in xyzw)
        R = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return cls(np.array(R), np.asarray(xyz, dtype=np.float64))

    def __matmul__(self, other: "Placement") -> "Placement":
        return Placement(self.R @ other.R, self.R @ other.t + self.t)

    def inverse(self) -> "Placement":
        """Return the placement of frame A in frame B."""
        return Placement(self.R.T, -(self.R.T @ self.t))

    def apply(self, points: ArrayLike) -> Array:
        """Return points given in B, (3,) or (…, 3), in A, m."""
        moved: Array = np.asarray(points, dtype=np.float64) @ self.R.T + self.t
        return moved

    def rpy(self) -> tuple[float, float, float]:
        """Return the rotation as URDF's roll, pitch, yaw [rad]; roll is 0 if pitch is ±90°."""
        R = self.R
        level = math.hypot(R[0, 0], R[1, 0])
        pitch = math.atan2(-R[2, 0], level)
        if level < 1e-9:
            return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])
        return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])

    def xyzw(self) -> tuple[float, float, float, float]:
        """Return the rotation as a unit quaternion (x, y, z, w) with w ≥ 0.

        It is computed from its largest component (Shepperd's method), so it is accurate for every rotation.
        """
        R = self.R
        squares = np.array(
            [
                1 + R[0, 0] - R[1, 1] - R[2, 2],
                1 - R[0, 0] + R[1, 1] - R[2, 2],
                1 - R[0, 0] - R[1, 1] + R[2, 2],
                1 + R[0, 0] + R[1, 1] + R[2, 2],
            ]
        )
        products = np.array(
            [
                [squares[0], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
                [R[0, 1] + R[1, 0], squares[1], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
                [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], squares[2], R[1, 0] - R[0, 1]],
                [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], squares[3]],
            ]
        )
        quaternion = products[int(np.argmax(squares))]
        quaternion = quaternion / np.linalg.norm(quaternion)
        x, y, z, w = (float(c) for c in (quaternion if quaternion[3] >= 0 else -quaternion))
        return x, y, z, w
