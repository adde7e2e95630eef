"""Where the leader's tool goes: as with a joystick, or straight at the follower."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMOOTH = 0.3
"""Time constant with which the robot follows the stick, twice in a row, s."""
TURN = (0.4, 1.4)
"""How long the stick stays where it is, s."""
TRIES = 2_000
"""Directions that are tried for a dash before it ends farther behind its place."""
LET_GO = 2.0
"""How long before the end the stick is let go, s: a path ends at rest."""
FINER = 3
"""How many steps of the hands make one sample."""
FULL = 0.999
"""Share of the largest speed that is reached: what is read from a file is rounded."""
RELEASED = 0.15
"""How often the stick is let go."""


def joystick(seed: int, speed: float, middle: Array, half: Array, *, seconds: float, period: float) -> Array:
    """A tool's way under somebody's hands: full deflections in changing directions, with pauses.

    Velocity follows the stick by two first-order lags, so that acceleration has no jumps. Near a side of the
    box the stick points back inside.

    Args:
        seed: Of chance.
        speed: Largest, m/s; it is reached.
        middle: Of the box (3,), m; where it begins.
        half: Half sides of the box (3,), m.
        seconds: About how long; the way is played faster as a whole where it would not reach its speed.
        period: Time between two samples, s.

    Returns:
        Samples (k, 3), world, m.
    """
    fine = period / FINER
    way = _under_hands(np.random.default_rng(seed), speed, middle, half, round(seconds / fine) + 1, fine)
    fastest = float(np.linalg.norm(np.diff(way, axis=0), axis=1).max()) / fine
    pace = FULL * speed / fastest
    times = np.arange(0.0, (len(way) - 1) * fine / pace, period) * pace
    columns = [np.interp(times, fine * np.arange(len(way)), way[:, axis]) for axis in range(3)]
    return np.column_stack(columns)


def _under_hands(
    rng: np.random.Generator, speed: float, middle: Array, half: Array, count: int, step: float
) -> Array:
    p, v, command, stick = np.array(middle), np.zeros(3), np.zeros(3), np.zeros(3)
    until, share, samples = 0.0, 1.0 - np.exp(-step / SMOOTH), []
    for k in range(count):
        samples.append(p)
        if k * step >= until:
            until = k * step + rng.uniform(*TURN)
            stick = _deflection(rng)
        end = p + 2.0 * SMOOTH * v  # about where it would come to rest
        outside = np.abs(end - middle) > half
        stick = np.where(outside, -np.sign(end - middle) * np.maximum(np.abs(stick), 0.5), stick)
        stick = stick / max(1.0, float(np.linalg.norm(stick)))
        if (count - k) * step < LET_GO:
            stick = np.zeros(3)
        command = command + share * (speed * stick - command)
        v = v + share * (command - v)
        p = p + step * v
    return np.array(samples)


def _deflection(rng: np.random.Generator) -> Array:
    if rng.uniform() < RELEASED:
        return np.zeros(3)
    u = rng.normal(size=3)
    return np.asarray(u / np.linalg.norm(u), dtype=np.float64)


def dash(place: Array, seed: int, way: float, low: Array, high: Array) -> tuple[Array, Array]:
    """Beginning and end (3,), m, of a straight way that ends at a place, from a chance direction.

    Where the tool cannot be as far away as that, the way goes through the place and ends behind it.

    Args:
        place: Where to (3,), m; cut to what the tool can reach.
        seed: Of chance.
        way: How long, m.
        low: Where the tool can be, smallest coordinates (3,), m.
        high: The same, largest.

    Raises:
        ValueError: No such way fits into where the tool can be.
    """
    rng = np.random.default_rng(seed)
    place = np.clip(place, low, high)
    for beyond in np.repeat(np.linspace(0.0, 0.5 * way, 11), TRIES):
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        begin, end = place + (way - beyond) * u, place - beyond * u
        if all(((p >= low) & (p <= high)).all() for p in (begin, end)):
            return begin, end
    raise ValueError(f"no straight way of {way:g} m to {place} within {low} to {high}")


def straight(begin: Array, end: Array, speed: float, period: float) -> Array:
    """Samples (k, 3), m, of the straight way from one place to another at a speed."""
    steps = max(1, round(float(np.linalg.norm(end - begin)) / (speed * period)))
    shares = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return begin + shares * (end - begin)
