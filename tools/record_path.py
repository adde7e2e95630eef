"""Make ``configs/paths/inspection.csv``: an inspection tour of GR's tool, as driven by an operator.

The file is synthetic: it was not recorded on a machine. It visits the instruments at the demo cell's process
structure and rests at each. A leg is a Bézier curve in joint space through the places below; the tool's speed
along it rises and falls smoothly and reaches 0.25 m/s on the long legs.

    python tools/record_path.py configs/paths/inspection.csv
"""

import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Robot, build_cell
from armgate.cell.config import load_config

Array = NDArray[np.float64]

ROBOT = "GR"
PERIOD = 0.048
SPEED = 0.249
"""Largest speed of the tool, m/s: between samples it is slightly higher, up to 0.25."""
RAMP = 0.6
"""Time from rest to full speed, s."""
LEVER = 0.3
"""Distance of the tool that counts like a rotation of 1 rad in the speed along a leg, m."""

HOME = (2.93, 0.0, 2.48, 0.0, -90.0, 90.0, 0.0, -90.0, 0.0)
"""Carriage in m, arm in degrees: where GR starts in configs/demo.yaml."""

Place = tuple[float, ...]


class Leg(NamedTuple):
    """Leg of the tour to an instrument, or around it.

    Attributes:
        speed: Largest speed of the tool, m/s.
        rest: Time for which the tool rests at its end, s.
        places: Positions: the last one is reached, the others are control points of the curve.
    """

    speed: float
    rest: float
    places: tuple[Place, ...]


VALVE_FEED = (3.16, -0.58, 2.22, 4, -88, 92, 0, -94, 0)
VALVE_RETURN = (3.18, 0.55, 2.20, -5, -87, 91, 0, -93, 15)
GAUGE = (2.78, 0.50, 2.76, 0, -93, 88, 0, -86, 0)
FLANGE = (2.70, -0.40, 2.66, 3, -90, 90, 0, -90, -10)
LEGS = (
    Leg(SPEED, 1.0, ((3.08, -0.35, 2.40, 0, -90, 90, 0, -90, 0), VALVE_FEED)),
    Leg(0.08, 1.2, ((3.20, -0.60, 2.18, 6, -86, 93, 0, -98, 8), (3.12, -0.56, 2.20, 2, -88, 92, 0, -95, 12))),
    Leg(SPEED, 1.0, ((3.10, -0.40, 2.36, 0, -90, 90, 0, -92, 0), (3.12, 0.05, 2.30, 0, -90, 90, 0, -90, 0))),
    Leg(0.15, 0.5, ((3.14, 0.15, 2.16, 0, -90, 90, 0, -90, 0), (3.16, 0.30, 2.18, -2, -88, 90, 0, -92, 5))),
    Leg(0.20, 1.2, ((3.16, 0.45, 2.20, -4, -88, 91, 0, -92, 10), VALVE_RETURN)),
    Leg(0.08, 1.0, ((3.22, 0.57, 2.24, -8, -85, 92, 0, -97, 22), (3.12, 0.55, 2.22, -3, -88, 91, 0, -93, 8))),
    Leg(SPEED, 1.4, ((2.95, 0.62, 2.52, -3, -90, 90, 0, -90, 8), GAUGE)),
    Leg(0.12, 0.8, ((2.74, 0.40, 2.80, 3, -95, 86, 0, -82, -6), (2.80, 0.32, 2.72, 4, -92, 88, 0, -85, -8))),
    Leg(SPEED, 1.2, ((2.72, 0.10, 2.80, 0, -92, 89, 0, -88, 0), FLANGE)),
    Leg(
        0.10,
        1.0,
        ((2.68, -0.52, 2.58, 6, -88, 91, 0, -93, -18), (2.76, -0.48, 2.52, 4, -89, 91, 0, -92, -12)),
    ),
    Leg(SPEED, 0.8, ((3.00, -0.62, 2.16, 0, -90, 90, 0, -90, 0), (3.20, 0.20, 2.20, 0, -88, 90, 0, -92, 0))),
    Leg(0.22, 0.8, ((3.02, 0.64, 2.40, 0, -90, 90, 0, -90, 0), (2.68, 0.24, 2.78, 0, -91, 90, 0, -89, 0))),
    Leg(SPEED, 0.6, ((2.60, -0.30, 2.60, 0, -90, 90, 0, -90, 0), HOME)),
)


def main(file: Path) -> None:
    """Write the path file."""
    cell = build_cell(load_config([Path(__file__).parents[1] / "configs" / "demo.yaml"]))
    robot = cell.robot(ROBOT)
    q = np.concatenate(list(tour(robot)))
    header = [
        "# armgate path 1",
        f"# robot: {ROBOT}",
        "# joints: X Y Z A1 A2 A3 A4 A5 A6",
        "# units: m m m deg deg deg deg deg deg",
        f"# sample time: {PERIOD:g}",
        "# An inspection tour of the demo cell. Synthetic, made by tools/record_path.py.",
        "t,X,Y,Z,A1,A2,A3,A4,A5,A6",
    ]
    rows = [f"{i * PERIOD:.3f}," + ",".join(f"{value + 0.0:.6f}" for value in row) for i, row in enumerate(q)]
    file.write_text("\n".join([*header, *rows]) + "\n", encoding="utf-8")
    ways = np.linalg.norm(np.diff(tool_places(robot, q), axis=0), axis=1)
    sys.stdout.write(
        f"{file}: {len(q)} samples, {(len(q) - 1) * PERIOD:.1f} s, {ways.max() / PERIOD:.4f} m/s\n"
    )


def tour(robot: Robot) -> Iterator[Array]:
    """Return the samples, leg by leg, in file units (k, 9)."""
    here: Place = HOME
    yield np.array([here] * round(0.5 / PERIOD))
    for leg in LEGS:
        yield driven(robot, np.array([here, *leg.places], dtype=float), leg.speed)
        here = leg.places[-1]
        yield np.array([here] * round(leg.rest / PERIOD), dtype=float)


def driven(robot: Robot, corners: Array, speed: float) -> Array:
    """Return samples from the first corner (left out) to the last, at rest there (k, 9)."""
    curve = rounded(corners)
    way = np.concatenate([[0.0], np.cumsum(steps(robot, curve))])
    along = profile(float(way[-1]), speed)
    return np.stack([np.interp(along, way, column) for column in curve.T], axis=1)


def rounded(corners: Array, samples: int = 3000) -> Array:
    """Return a Bézier curve (samples, n) from first to last corner, the others as control points."""
    u = np.linspace(0.0, 1.0, samples)[:, None]
    points = [np.broadcast_to(corner, (samples, corners.shape[1])) for corner in corners]
    while len(points) > 1:
        points = [(1.0 - u) * a + u * b for a, b in pairwise(points)]
    return points[0]


def steps(robot: Robot, curve: Array) -> Array:
    """Return the length of each step of a curve (k - 1,), m: the tool's path, and the scaled rotations."""
    ways = np.linalg.norm(np.diff(tool_places(robot, curve), axis=0), axis=1)
    turns = np.linalg.norm(np.radians(np.diff(curve[:, 3:], axis=0)), axis=1)
    lengths: Array = np.hypot(ways, LEVER * turns)
    return lengths


def tool_places(robot: Robot, q: Array) -> Array:
    """Return the positions of the tool (k, 3), world, m, for samples in file units."""
    inside = np.concatenate([q[:, :3], np.radians(q[:, 3:])], axis=1)
    return np.array([robot.model.frame(row, robot.tool).t for row in inside])


def profile(length: float, speed: float) -> Array:
    """Return the distance along a leg at each sample after its start; its speed rises and falls as sin²."""
    ramp = min(RAMP, length / speed)
    total = length / speed + ramp
    t: Array = np.arange(1.0, np.ceil(total / PERIOD) + 1.0) * PERIOD
    braking: Array = t - (total - ramp)
    return speed * (ramped(t, ramp) - ramped(braking, ramp))


def ramped(t: Array, ramp: float) -> Array:
    """Return the distance at time t for a speed that rises from 0 to 1 as sin²(πt / 2·ramp), then stays."""
    rising = np.clip(t, 0.0, ramp)
    way = rising / 2 - ramp / (2 * np.pi) * np.sin(np.pi * rising / ramp)
    return way + np.clip(t - ramp, 0.0, None)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
