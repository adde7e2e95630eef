"""Gantry as in docs/configuration.md: joints X, Y, Z, and the boxes of rails, posts, bridge and column."""

from dataclasses import dataclass

import numpy as np

from armgate.monitor.config_section import Section
from armgate.monitor.convex_solid import Solid, primitive
from armgate.monitor.errors import DescriptionError
from armgate.monitor.transforms import Array, placement
from armgate.monitor.urdf_file import Body, Description, Joint

KEYS = ("travel", "speed", "acceleration", "height", "span", "beam", "column", "mount")
AXES = ("X", "Y", "Z")
LINKS = ("gantry", "gantry_x", "gantry_y", "gantry_z")
_GAP = 0.1
"""Gap between column and bridge, m."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of a gantry, m: height below the rails, distance of the rails, widths of beams and column."""

    height: float
    span: float
    beam: float
    column: float


def add_gantry(arm: Description, gantry: Section) -> Description:
    """Return the description of an arm mounted below a gantry."""
    gantry.only(*KEYS)
    travel = gantry.section("travel")
    ranges = [travel.numbers(axis.lower(), (0.0, 0.0), "length") for axis in AXES]
    speed = gantry.number("speed", 1.0, "length", 1)
    sizes = Sizes(
        *(
            gantry.number(key, default, "length")
            for key, default in (("height", 3.5), ("span", 4.6), ("beam", 0.3), ("column", 0.2))
        )
    )
    if set(LINKS) & set(arm.links) or set(AXES) & {joint.name for joint in arm.joints}:
        raise DescriptionError(f"{gantry.where}: the arm uses link or joint names of the gantry")
    joints = [
        Joint(name, "prismatic", LINKS[i], LINKS[i + 1], np.eye(4), np.eye(3)[i], lower, upper, speed)
        for i, (name, (lower, upper)) in enumerate(zip(AXES, ranges, strict=True))
    ]
    mount = Joint("gantry_mount", "fixed", LINKS[-1], arm.root, gantry.section("mount").pose(), np.eye(3)[0])
    bodies = [*_frame(ranges[0], sizes), *_carriage(ranges[2][0], sizes)]
    return Description(LINKS[0], [*LINKS, *arm.links], [*joints, mount, *arm.joints], bodies + arm.bodies)


def _box(name: str, link: str, size: tuple[float, float, float], centre: tuple[float, float, float]) -> Body:
    solid: Solid = primitive("box", size, name)
    where: Array = placement(centre, (0.0, 0.0, 0.0))
    return Body(name, link, where, solid)


def _frame(x: list[float], s: Sizes) -> list[Body]:
    """Return two rails along x, each on two posts."""
    start, end = x[0] - 2.0 * s.beam, x[1] + 3.0 * s.beam
    bodies = []
    for side, y in (("left", s.span / 2.0), ("right", -s.span / 2.0)):
        centre = ((start + end) / 2.0, y, s.height + s.beam / 2.0)
        bodies.append(_box(f"gantry_rail_{side}", LINKS[0], (end - start, s.beam, s.beam), centre))
        for place, at in (("front", start), ("back", end)):
            post = (at, y, s.height / 2.0)
            bodies.append(_box(f"gantry_post_{side}_{place}", LINKS[0], (s.beam, s.beam, s.height), post))
    return bodies


def _carriage(lowest: float, s: Sizes) -> list[Body]:
    """Return the bridge along y, the trolley on it, and the column, whose lower end carries the arm."""
    bridge = s.column / 2.0 + _GAP + s.beam / 2.0
    behind, front = bridge + s.beam / 2.0, -s.column / 2.0 - _GAP / 2.0
    trolley = (behind - front, s.column + _GAP, s.beam / 2.0)
    length = s.height + 1.5 * s.beam - lowest
    return [
        _box("gantry_bridge", LINKS[1], (s.beam, s.span, s.beam), (bridge, 0.0, s.height + s.beam / 2.0)),
        _box("gantry_trolley", LINKS[2], trolley, ((front + behind) / 2.0, 0.0, s.height + 1.25 * s.beam)),
        _box("gantry_column", LINKS[3], (s.column, s.column, length), (0.0, 0.0, length / 2.0)),
    ]
