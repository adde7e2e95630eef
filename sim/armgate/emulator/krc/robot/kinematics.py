"""Pose of the flange for RIst and RSol: a chain of rigid segments and axes, without numpy.

A KUKA pose is X, Y, Z [mm] and A, B, C [deg] with R = Rz(A)·Ry(B)·Rx(C).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Pose = tuple[float, float, float, float, float, float]
"""X, Y, Z [mm], A, B, C [deg]."""

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Segment:
    """Frame fixed in the previous one, with an optional axis about which all following segments turn.

    Attributes:
        rotation: Rotation in the previous frame.
        origin: Origin in the previous frame, mm.
        axis: Unit vector of the axis; None: no axis.
    """

    rotation: Matrix
    origin: Vector
    axis: Vector | None


class Chain:
    """Serial arm.

    Args:
        segments: Segments from the foot to the flange.
    """

    def __init__(self, segments: Sequence[Segment]) -> None:
        self._segments = tuple(segments)

    def pose(self, angles: Sequence[float]) -> Pose:
        """Return the pose of the flange in the frame of the foot, for the axes' angles [deg]."""
        R, t = IDENTITY, (0.0, 0.0, 0.0)
        turning = iter(angles)
        for segment in self._segments:
            x, y, z = times(R, segment.origin)
            t = (t[0] + x, t[1] + y, t[2] + z)
            if segment.rotation != IDENTITY:  # most frames have the orientation of the one before
                R = product(R, segment.rotation)
            if segment.axis is not None:
                R = product(R, about(segment.axis, math.radians(next(turning))))
        return (*t, *euler(R))


def times(R: Matrix, v: Vector) -> Vector:
    """Return ``R v``."""
    (a, b, c), (d, e, f), (g, h, i) = R
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def product(R: Matrix, S: Matrix) -> Matrix:
    """Return ``R S``."""
    columns = [times(R, (S[0][k], S[1][k], S[2][k])) for k in range(3)]
    (a, d, g), (b, e, h), (c, f, i) = columns
    return (a, b, c), (d, e, f), (g, h, i)


def about(axis: Vector, angle: float) -> Matrix:
    """Return the rotation about a unit vector by an angle [rad] (Rodrigues' formula)."""
    x, y, z = axis
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    return (
        (c + x * x * d, x * y * d - z * s, x * z * d + y * s),
        (y * x * d + z * s, c + y * y * d, y * z * d - x * s),
        (z * x * d - y * s, z * y * d + x * s, c + z * z * d),
    )


def euler(R: Matrix) -> Vector:
    """Return A, B, C [deg] of a rotation."""
    A = math.atan2(R[1][0], R[0][0])
    B = math.atan2(-R[2][0], math.hypot(R[0][0], R[1][0]))
    C = math.atan2(R[2][1], R[2][2])
    return math.degrees(A), math.degrees(B), math.degrees(C)
