"""Small cells of simulations: two planar arms with two joints each, near each other and near a post."""

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import in_lockstep, load_config

LENGTHS = (0.3, 0.25)
RADII = (0.04, 0.035)
BASES = {"A": (0.0, 0.0), "B": (0.85, 0.0)}
POST, POST_RADIUS = (0.4, 0.48), 0.05
KEPT = 0.02
"""Distance between bodies that the gate keeps, m."""

PARTICIPANTS = ("left", "right")

_URDF = """<robot name="planar2">
  <link name="base_link"/>
  <link name="link_1"><collision><origin xyz="{h1} 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><capsule radius="{r1}" length="{l1}"/></geometry></collision></link>
  <link name="link_2"><collision><origin xyz="{h2} 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><capsule radius="{r2}" length="{l2}"/></geometry></collision></link>
  <link name="tool0"/>
  <joint name="J1" type="revolute"><parent link="base_link"/><child link="link_1"/><axis xyz="0 0 1"/>
    <limit lower="-2.9" upper="2.9" velocity="2.0" effort="0"/></joint>
  <joint name="J2" type="revolute"><parent link="link_1"/><child link="link_2"/><origin xyz="{l1} 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2.6" upper="2.6" velocity="2.5" effort="0"/></joint>
  <joint name="mount" type="fixed"><parent link="link_2"/><child link="tool0"/>
    <origin xyz="{l2} 0 0"/></joint>
</robot>
"""

_CELL = """armgate: 1
name: simulated
stop_distance: 20 mm
self_distance: 10 mm
response: {response}
robots:
  A:
    urdf: planar2.urdf
    base: {{xyz: [{ax}, {ay}, 0.5]}}
    start: [90 deg, 0 deg]
    period: {a}
    link: {{kind: emulated, lag: {lag}}}
  B:
    urdf: planar2.urdf
    base: {{xyz: [{bx}, {by}, 0.5]}}
    start: [-90 deg, 0 deg]
    period: {b}
    link: {{kind: emulated, lag: {lag}}}
surroundings:
  post: {{shape: {{cylinder: [{pr}, 1.0]}}, xyz: [{px}, {py}, 0.5]}}
server: {{port: 7411, lease_ttl: {ttl}, handshake_timeout: 2.0, max_connections: 24}}
recording: {{queue: 512, rotate: 1048576}}
"""

_FILES = tempfile.TemporaryDirectory(prefix="armgate-simulation-")


@dataclass(frozen=True)
class Variant:
    """Variant of the cell.

    Attributes:
        periods: Periods of both robots, s.
        lag: Lag of both robots, s.
        response: The gate's response near a violation.
        ttl: Time to live of leases, s.
    """

    periods: tuple[float, float]
    lag: float
    response: str
    ttl: float


VARIANTS = (
    Variant((0.012, 0.012), 0.0, "stop", 0.4),
    Variant((0.01, 0.03), 0.02, "slow", 0.3),
    Variant((0.02, 0.02), 0.03, "stop", 0.5),
    Variant((0.1, 0.1), 0.0, "slow", 1.0),
)


@cache
def cell_of(variant: Variant, lockstep: bool) -> Cell:
    """Return the cell of a variant; it is built once."""
    folder = Path(tempfile.mkdtemp(dir=_FILES.name))  # read again for a recording
    h1, h2 = (length / 2 for length in LENGTHS)
    (l1, l2), (r1, r2) = LENGTHS, RADII
    (folder / "planar2.urdf").write_text(_URDF.format(h1=h1, h2=h2, l1=l1, l2=l2, r1=r1, r2=r2))
    (ax, ay), (bx, by), (px, py) = BASES["A"], BASES["B"], POST
    a, b = variant.periods
    own = {"ax": ax, "ay": ay, "bx": bx, "by": by, "px": px, "py": py, "pr": POST_RADIUS, "a": a, "b": b}
    text = _CELL.format(**own, lag=variant.lag, response=variant.response, ttl=variant.ttl)
    (folder / "cell.yaml").write_text(text)
    config = load_config([folder / "cell.yaml"])
    return build_cell(in_lockstep(config, PARTICIPANTS) if lockstep else config)


# --- an independent model of the cell: planar kinematics and distances of segments -------------------------

Point = tuple[float, float]
Segment = tuple[Point, Point, float]
"""Both ends and the radius of a capsule, m."""


def segments(robot: str, q: Sequence[float]) -> list[Segment]:
    """Return the bodies of a robot at a position."""
    x, y = BASES[robot]
    angle, found = 0.0, []
    for length, radius, turn in zip(LENGTHS, RADII, q, strict=True):
        angle += turn
        end = x + length * math.cos(angle), y + length * math.sin(angle)
        found.append(((x, y), end, radius))
        x, y = end
    return found


def distance(one: Segment, other: Segment) -> float:
    """Return the distance of two capsules in the plane, m; negative if they overlap."""
    (a, b, r), (c, d, s) = one, other
    if _cross(a, b, c, d):
        return -r - s
    apart = min(_to_point(a, b, c), _to_point(a, b, d), _to_point(c, d, a), _to_point(c, d, b))
    return apart - r - s


def clearance(q: Mapping[str, Sequence[float]]) -> float:
    """Return the smallest distance between the robots, and between each and the post, m."""
    bodies = {robot: segments(robot, position) for robot, position in q.items()}
    post = POST, POST_RADIUS
    found = [_to_point(a, b, post[0]) - r - post[1] for own in bodies.values() for a, b, r in own]
    if len(bodies) == 2:
        found += [distance(one, other) for one in bodies["A"] for other in bodies["B"]]
    return min(found)


def _to_point(a: Point, b: Point, p: Point) -> float:
    ux, uy = b[0] - a[0], b[1] - a[1]
    wx, wy = p[0] - a[0], p[1] - a[1]
    t = min(1.0, max(0.0, (ux * wx + uy * wy) / (ux * ux + uy * uy)))
    return math.hypot(wx - t * ux, wy - t * uy)


def _side(a: Point, b: Point, p: Point) -> float:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0
