"""3-vectors as tuples of Python floats.

An evaluation of the control law uses a handful of single vectors. numpy has a fixed cost per call: a cross
product of two arrays takes as long as a whole forward kinematics, but that of two tuples takes a fraction of
a microsecond. Stacks of vectors remain arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt

V3 = tuple[float, float, float]


def vector(values: Iterable[float]) -> V3:
    """Return `values` as a 3-vector of floats; ValueError if there are not exactly three."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def dot(a: V3, b: V3) -> float:
    """Return the dot product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: V3, b: V3) -> V3:
    """Return the cross product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def norm(a: V3) -> float:
    """Return ‖a‖."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def wrench(force: V3, point: V3) -> tuple[float, float, float, float, float, float]:
    """Return [f; p × f] of a force f at a point p: its joint force is Jᵀ·wrench, J at the world's origin."""
    return *force, *cross(point, force)
