"""Stops by the rule of the protocol: a robot brakes along its increment, which shrinks in proportion.

From the increment u with decelerations d and period T: m = max_j |u_j| / (d_j T²); then follow u·(1 − k/m)
for k = 1 … ⌊m⌋. Their sum is S·u with S = n − n (n + 1) / (2 m), n = ⌊m⌋ (0 if m < 1).
"""

import numpy as np

from armgate.monitor.transforms import Array

_ROUNDING = 1e-9
_TRIES = 60


def ratio(u: Array, decel: Array) -> float:
    """Return m: how many ticks' worth of the most demanding joint's deceleration the increment is."""
    return float(np.max(np.abs(u) / decel, initial=0.0))


def rest_of(u: Array, decel: Array) -> Array:
    """Return what a robot still moves after the increment u if no command follows.

    Args:
        u: (n,).
        decel: Deceleration times T², (n,); inf: stops at once.
    """
    m = ratio(u, decel)
    n = np.floor(m + _ROUNDING)
    return u * (n - n * (n + 1.0) / (2.0 * m)) if n > 0.0 else np.zeros_like(u)


def increment_to(way: Array, decel: Array) -> Array:
    """Return the increment whose whole stop, itself included, is this way: (1 + S) u = way.

    The whole stop grows with the increment, so bisection finds it.
    """
    low, high = 0.0, 1.0
    for _ in range(_TRIES):
        middle = (low + high) / 2.0
        u = middle * way
        long = float(np.dot(u + rest_of(u, decel), way)) > float(np.dot(way, way))
        low, high = (low, middle) if long else (middle, high)
    return high * way


def change_excess(before: Array, after: Array, accel: Array, decel: Array) -> Array:
    """Return by which factor an increment's change exceeds its bounds, joint by joint; at most 1 is allowed.

    It may grow by ``accel``, shrink by ``decel``, and if it changes its sign, what it loses and what it gains
    share one tick: |u|/d + |u′|/a ≤ 1.
    """
    grown, lost = np.abs(after) - np.abs(before), np.abs(before) - np.abs(after)
    same = np.maximum(grown / accel, lost / decel)
    turned = np.abs(before) / decel + np.abs(after) / accel
    return np.where(before * after < 0.0, turned, same)
