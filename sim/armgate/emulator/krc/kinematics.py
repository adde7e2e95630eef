"""Where the flange is, for RIst and RSol: a chain of rigid segments and axes, in plain numbers.

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
    """A frame fixed in the one before it, then perhaps an axis about which the rest turns.

    Attributes:
        rotation: In the frame before.
        origin: In the frame before, mm.
        axis: A unit vector; None: nothing turns.
    """

    rotation: Matrix
    origin: Vector
    axis: Vector | None


class Chain:
    """A serial arm.

    Args:
        segments: From the foot to the flange.
    """

    def __init__(self, segments: Sequence[Segment]) -> None:
        self._segments = tuple(segments)

    def pose(self, angles: Sequence[float]) -> Pose:
        """The flange seen from the foot, for the axes' angles [deg]."""
        R, t = IDENTITY, (0.0, 0.0, 0.0)
        turning = iter(angles)
        for segment in self._segments:
            x, y, z = times(R, segment.origin)
            t = (t[0] + x, t[1] + y, t[2] + z)
            if segment.rotation != IDENTITY:  # most frames are parallel at zero
                R = product(R, segment.rotation)
            if segment.axis is not None:
                R = product(R, about(segment.axis, math.radians(next(turning))))
        return (*t, *euler(R))


def times(R: Matrix, v: Vector) -> Vector:
    """``R v``."""
    (a, b, c), (d, e, f), (g, h, i) = R
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def product(R: Matrix, S: Matrix) -> Matrix:
    """``R S``."""
    columns = [times(R, (S[0][k], S[1][k], S[2][k])) for k in range(3)]
    (a, d, g), (b, e, h), (c, f, i) = columns
    return (a, b, c), (d, e, f), (g, h, i)


def about(axis: Vector, angle: float) -> Matrix:
    """Rotation about a unit vector by an angle [rad] (Rodrigues)."""
    x, y, z = axis
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    return (
        (c + x * x * d, x * y * d - z * s, x * z * d + y * s),
        (y * x * d + z * s, c + y * y * d, y * z * d - x * s),
        (z * x * d - y * s, z * y * d + x * s, c + z * z * d),
    )


def euler(R: Matrix) -> Vector:
    """A, B, C [deg] of a rotation."""
    A = math.atan2(R[1][0], R[0][0])
    B = math.atan2(-R[2][0], math.hypot(R[0][0], R[1][0]))
    C = math.atan2(R[2][1], R[2][2])
    return math.degrees(A), math.degrees(B), math.degrees(C)
