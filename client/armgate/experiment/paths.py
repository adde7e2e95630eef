"""Paths of the leader's tool: as driven by a joystick, or straight at the follower."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMOOTH = 0.3
"""Time constant of the two first-order lags between stick and velocity, s."""
TURN = (0.4, 1.4)
"""Time for which the stick stays at one position, s: minimum and maximum."""
TRIES = 2_000
"""Number of random directions that are tried for each distance of a dash's end behind its target."""
RELEASE_TIME = 2.0
"""Time before the end at which the stick is released, s: a path ends at rest."""
FINER = 3
"""Integration steps per sample."""
FULL = 0.999
"""Share of the largest speed that a path reaches; the remainder allows for rounding in the file."""
RELEASED = 0.15
"""Probability that the stick is released."""


def joystick(seed: int, speed: float, middle: Array, half: Array, *, seconds: float, period: float) -> Array:
    """Return a tool path as driven with a joystick: full deflections in changing directions, with pauses.

    Velocity follows the stick with two first-order lags, so that acceleration is continuous. Near a side of
    the box the stick points inwards.

    Args:
        seed: Seed of the random numbers.
        speed: Largest speed, m/s; the path reaches 99.9 % of it.
        middle: Centre of the box (3,), m; the path begins there.
        half: Half sides of the box (3,), m.
        seconds: Approximate duration; the path is scaled in time as a whole to reach its speed.
        period: Time between two samples, s.

    Returns:
        Samples (k, 3), world, m.
    """
    fine = period / FINER
    way = _stick_motion(np.random.default_rng(seed), speed, middle, half, round(seconds / fine) + 1, fine)
    fastest = float(np.linalg.norm(np.diff(way, axis=0), axis=1).max()) / fine
    pace = FULL * speed / fastest
    times = np.arange(0.0, (len(way) - 1) * fine / pace, period) * pace
    columns = [np.interp(times, fine * np.arange(len(way)), way[:, axis]) for axis in range(3)]
    return np.column_stack(columns)


def _stick_motion(
    rng: np.random.Generator, speed: float, middle: Array, half: Array, count: int, step: float
) -> Array:
    p, v, command, stick = np.array(middle), np.zeros(3), np.zeros(3), np.zeros(3)
    until, share, samples = 0.0, 1.0 - np.exp(-step / SMOOTH), []
    for k in range(count):
        samples.append(p)
        if k * step >= until:
            until = k * step + rng.uniform(*TURN)
            stick = _deflection(rng)
        end = p + 2.0 * SMOOTH * v  # approximate point of rest
        outside = np.abs(end - middle) > half
        stick = np.where(outside, -np.sign(end - middle) * np.maximum(np.abs(stick), 0.5), stick)
        stick = stick / max(1.0, float(np.linalg.norm(stick)))
        if (count - k) * step < RELEASE_TIME:
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


def dash(place: Array, seed: int, length: float, low: Array, high: Array) -> tuple[Array, Array]:
    """Return start and end (3,), m, of a straight line to a point, from a random direction.

    If the tool cannot start that far away, the line passes through the point and ends behind it.

    Args:
        place: Target (3,), m; clipped to the tool's region.
        seed: Seed of the random numbers.
        length: Length of the line, m.
        low: Smallest coordinates of the tool (3,), m.
        high: Largest coordinates of the tool (3,), m.

    Raises:
        ValueError: No such line fits into the tool's region.
    """
    rng = np.random.default_rng(seed)
    place = np.clip(place, low, high)
    for beyond in np.repeat(np.linspace(0.0, 0.5 * length, 11), TRIES):
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        begin, end = place + (length - beyond) * u, place - beyond * u
        if all(((p >= low) & (p <= high)).all() for p in (begin, end)):
            return begin, end
    raise ValueError(f"no straight line of {length:g} m to {place} within {low} to {high}")


def straight(begin: Array, end: Array, speed: float, period: float) -> Array:
    """Return samples (k, 3), m, of the straight line from one point to another at a speed."""
    steps = max(1, round(float(np.linalg.norm(end - begin)) / (speed * period)))
    shares = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return begin + shares * (end - begin)
