"""Braking along an increment: the straight stop that belongs to every admitted increment.

A robot that moves by ``u`` in one tick stops along the direction of ``u``. The increment decreases by the
same amount each tick, as fast as the most demanding joint may decelerate:

    m = max_j |u_j| / (d_j T²),   n = ⌊m⌋,   increments u, u(1 − 1/m), …, u(1 − n/m),

so that the whole stop is the straight segment q_ref → q_ref + (1 + S)·u with S = n − n(n + 1)/(2m).
After k of these increments, the remaining ones are the straight stop of the next increment. The remainder of
a stop is therefore always part of a path that is already proven.
"""

import math
from collections.abc import Sequence
from operator import add, truediv

from armgate.events import Joints


def ticks_to_rest(u: Sequence[float], decel: Sequence[float]) -> float:
    """Return m, the increment ``u`` in units of the strongest deceleration that its direction allows.

    Args:
        u: Increment of one tick, rad or m per joint.
        decel: Deceleration bound times T² per joint; infinite if a joint may stop at once.
    """
    return max(map(truediv, map(abs, u), decel), default=0.0)


def stop_share(m: float) -> float:
    """Return S = n − n(n + 1)/(2m): the length of the braking after the increment ``u``, divided by u."""
    n = math.floor(m)
    return n - n * (n + 1) / (2.0 * m) if n else 0.0


def stop_increments(u: Sequence[float], decel: Sequence[float]) -> tuple[Joints, ...]:
    """Return ``u`` and the increments that bring the robot to rest after it; () for a zero ``u``."""
    if not any(u):
        return ()
    m = ticks_to_rest(u, decel)
    shares = [1.0 - k / m for k in range(1, math.floor(m) + 1)]
    return tuple(u), *[tuple(map(share.__mul__, u)) for share in shares if share > 0.0]


def end_of(setpoint: Joints, increments: tuple[Joints, ...]) -> Joints:
    """Return the setpoint after all increments, added one by one as a link adds them."""
    for u in increments:
        setpoint = tuple(map(add, setpoint, u))
    return setpoint


def largest_stoppable_increment(room: float, decel: float) -> float:
    """Return the largest increment of one joint whose whole stop, u(1 + S), fits into ``room``.

    For n ≤ u/d < n + 1 the stop is (n + 1)u − n(n + 1)d/2; n is the largest for which n(n + 1)d/2 ≤ room.

    Args:
        room: Distance to the joint's limit, rad or m, not negative.
        decel: Deceleration bound times T².
    """
    if math.isinf(decel):
        return room
    n = math.floor((math.sqrt(1.0 + 8.0 * room / decel) - 1.0) / 2.0)
    return (room + n * (n + 1) * decel / 2.0) / (n + 1)
