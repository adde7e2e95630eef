"""Shaping of the increment of a tick: the braking-aware chord.

The integrated law gives the chord D = q^r − q from the setpoint to the end of the reference. Robots with
bounded acceleration that take the largest step towards the optimum in each tick overshoot it and oscillate. A
joint at the distance D from its goal, whose increment can decrease by at most a in each tick, arrives at rest
if its increment is at most

    u(D) = ½ (−a + √(a² + 8 a D)),

since braking from u in steps of a takes u (u + a) / 2a. The chord is scaled as a whole, so that every
joint stays within its u(D). A moving target moves the optimum by u_ff per tick: then only the rest of the
chord, D − u_ff, is scaled.
"""

from __future__ import annotations

import numpy as np

from armgate.control.weights import Vector

# Share of the acceleration bound used to plan braking; the rest is for disturbances.
RESERVE = 0.7


def braking_increment(way: Vector, change: Vector) -> Vector:
    """Return u(D) for distances D ≥ 0 and changes a > 0 of the increment per tick, (n,), rad or m."""
    u: Vector = 0.5 * (np.sqrt(change * (change + 8.0 * way)) - change)
    return u


def braking_way(increment: Vector, change: Vector) -> Vector:
    """Return D from which a joint with this increment just comes to rest; inverse of `braking_increment`."""
    way: Vector = increment * (increment + change) / (2.0 * change)
    return way


def shape_chord(chord: Vector, induced: Vector, step: Vector, change: Vector) -> Vector:
    """Return the increment along `chord`, (n,), rad or m.

    Args:
        chord: D = q^r − q.
        induced: u_ff, the increment by which the target's own motion moves the optimum each tick.
        step: increment bounds.
        change: bounds on the change of the increment per tick.
    """
    rest = chord - induced
    limit = np.minimum(
        braking_increment(np.abs(rest), RESERVE * change), np.maximum(step - np.abs(induced), 0.0)
    )
    moving = np.abs(rest) > 1e-15
    share = min(1.0, float((limit[moving] / np.abs(rest[moving])).min())) if moving.any() else 1.0
    u: Vector = induced + share * rest
    return u
