"""Braking by the rule of the protocol: along the increment, with all joints in proportion (CMD-28).

For the increment u, decelerations d and period T, let m = max_j |u_j| / (d_j T²). The next increments are
u·(1 − k/m), k = 1 … ⌊m⌋. Their sum is S·u with S = n − n (n + 1) / (2 m), n = ⌊m⌋ (0 if m < 1).
"""

import numpy as np

from armgate.monitor.transforms import Array

_ROUNDING = 1e-9
_TRIES = 60


def ratio(u: Array, decel: Array) -> float:
    """Return m: the largest ratio of increment to deceleration per tick of any joint."""
    return float(np.max(np.abs(u) / decel, initial=0.0))


def rest_of(u: Array, decel: Array) -> Array:
    """Return the remaining motion of a robot after the increment u if no command follows.

    Args:
        u: (n,).
        decel: Deceleration times T², (n,); inf if the joint stops at once.
    """
    m = ratio(u, decel)
    n = np.floor(m + _ROUNDING)
    return u * (n - n * (n + 1.0) / (2.0 * m)) if n > 0.0 else np.zeros_like(u)


def increment_to(motion: Array, decel: Array) -> Array:
    """Return the increment whose stop, including itself, is this motion: (1 + S) u = motion.

    The stop grows with the increment, so bisection finds it.
    """
    low, high = 0.0, 1.0
    for _ in range(_TRIES):
        middle = (low + high) / 2.0
        u = middle * motion
        long = float(np.dot(u + rest_of(u, decel), motion)) > float(np.dot(motion, motion))
        low, high = (low, middle) if long else (middle, high)
    return high * motion


def change_excess(before: Array, after: Array, accel: Array, decel: Array) -> Array:
    """Return the ratio of an increment's change to its bounds for each joint; at most 1 is allowed.

    An increment may grow by ``accel`` and shrink by ``decel``. If it changes its sign, loss and gain share
    one tick: |u|/d + |u′|/a ≤ 1.
    """
    grown, lost = np.abs(after) - np.abs(before), np.abs(before) - np.abs(after)
    same = np.maximum(grown / accel, lost / decel)
    turned = np.abs(before) / decel + np.abs(after) / accel
    return np.where(before * after < 0.0, turned, same)
