"""3-vectors as tuples of Python floats.

An evaluation of the control law meets a handful of single vectors. numpy charges by the call: a cross
product of two arrays costs as much as a whole forward kinematics, of two tuples a fraction of a
microsecond. Stacks of vectors stay arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt

V3 = tuple[float, float, float]


def vector(values: Iterable[float]) -> V3:
    """The 3-vector in `values` as a tuple of floats; ValueError if there are not exactly three."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def dot(a: V3, b: V3) -> float:
    """Dot product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: V3, b: V3) -> V3:
    """Cross product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def norm(a: V3) -> float:
    """‖a‖."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def wrench(force: V3, point: V3) -> tuple[float, float, float, float, float, float]:
    """[f; p × f]: a force f at the point p, whose joint force is Jᵀ·wrench, J at the world's origin."""
    return *force, *cross(point, force)
