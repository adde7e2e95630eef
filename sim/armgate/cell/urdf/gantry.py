"""Gantry that carries an arm: three prismatic joints and their bodies, added to the arm's URDF.

The joints X, Y, Z are the position of the carriage in the gantry's frame, so with the gantry's base at the
world's origin they are world coordinates. The carriage is the lower end of a vertical column; the arm's root
link is fixed to it by ``mount``. The column is modelled as one solid piece that rises above the bridge; a
telescopic column needs less space, so the model is conservative.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.shapes import Box
from armgate.cell.urdf.bodies import write_body
from armgate.cell.urdf.elements import add_joint, add_link, number_text
from armgate.cell.urdf.reader import read_robot

if TYPE_CHECKING:
    from armgate.cell.config import GantryConfig

GANTRY_LINKS = ("gantry", "gantry_x", "gantry_y", "gantry_z")
GANTRY_JOINTS = ("X", "Y", "Z")
_GAP = 0.1
"""Gap between the column and the bridge, m."""

Triple = tuple[float, float, float]

_AXES: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def add_gantry(robot: ET.Element, gantry: "GantryConfig") -> None:
    """Mount a robot on a gantry; its links and joints keep their names.

    Raises:
        ModelError: The robot is refused, or already has a link or joint with a name of the gantry.
    """
    arm_root = read_robot(robot).root
    taken = {element.get("name", "") for element in robot} & {*GANTRY_LINKS, *GANTRY_JOINTS}
    if taken:
        raise ModelError(f"the arm uses the gantry's names {', '.join(sorted(taken))}; expected others")
    base, x, y, z = (add_link(robot, name) for name in GANTRY_LINKS)
    _add_boxes(base, _portal(gantry))
    _add_boxes(x, [_bridge(gantry)])
    _add_boxes(y, [_trolley(gantry)])
    _add_boxes(z, [_column(gantry)])
    _add_axes(robot, gantry)
    origin = (gantry.mount.xyz, gantry.mount.rpy)
    add_joint(robot, "gantry_mount", "fixed", (GANTRY_LINKS[-1], arm_root), origin)
    read_robot(robot)  # names of the gantry's bodies can collide with the arm's


def _add_axes(robot: ET.Element, gantry: "GantryConfig") -> None:
    travels = (gantry.travel.x, gantry.travel.y, gantry.travel.z)
    for number, (name, axis, travel) in enumerate(zip(GANTRY_JOINTS, _AXES, travels, strict=True)):
        joint = add_joint(robot, name, "prismatic", (GANTRY_LINKS[number], GANTRY_LINKS[number + 1]))
        ET.SubElement(joint, "axis", xyz=number_text(axis))
        limits = {"lower": travel[0], "upper": travel[1], "velocity": gantry.speed, "effort": 0.0}
        ET.SubElement(joint, "limit", {key: number_text((value,)) for key, value in limits.items()})


# --- bodies: boxes (name, size, centre) in the frames of their links -------------------------------------

NamedBox = tuple[str, Triple, Triple]


def _portal(gantry: "GantryConfig") -> list[NamedBox]:
    """Return two rails along x, each on two posts."""
    lower, upper = gantry.travel.x
    beam, side = gantry.beam, gantry.span / 2
    ends = (lower - 2 * beam, upper + 3 * beam)
    length, middle = ends[1] - ends[0], (ends[0] + ends[1]) / 2
    boxes: list[NamedBox] = []
    for word, y in (("left", side), ("right", -side)):
        rail_size, rail_centre = (length, beam, beam), (middle, y, gantry.height + beam / 2)
        boxes.append((f"gantry_rail_{word}", rail_size, rail_centre))
        for end, x in (("front", ends[0]), ("back", ends[1])):
            post_size, post_centre = (beam, beam, gantry.height), (x, y, gantry.height / 2)
            boxes.append((f"gantry_post_{word}_{end}", post_size, post_centre))
    return boxes


def _bridge(gantry: "GantryConfig") -> NamedBox:
    """Return the beam along y, on the +x side of the column."""
    beam = gantry.beam
    return "gantry_bridge", (beam, gantry.span, beam), (_bridge_x(gantry), 0.0, gantry.height + beam / 2)


def _bridge_x(gantry: "GantryConfig") -> float:
    return gantry.column / 2 + _GAP + gantry.beam / 2


def _trolley(gantry: "GantryConfig") -> NamedBox:
    """Return the trolley, on top of the bridge, around bridge and column."""
    back = _bridge_x(gantry) + gantry.beam / 2
    front = -gantry.column / 2 - _GAP / 2
    height = gantry.beam / 2
    centre = ((front + back) / 2, 0.0, gantry.height + gantry.beam + height / 2)
    return "gantry_trolley", (back - front, gantry.column + _GAP, height), centre


def _column(gantry: "GantryConfig") -> NamedBox:
    """Return the column, long enough to reach the trolley from the lowest carriage."""
    length = gantry.height + 1.5 * gantry.beam - gantry.travel.z[0]
    return "gantry_column", (gantry.column, gantry.column, length), (0.0, 0.0, length / 2)


def _add_boxes(link: ET.Element, boxes: Iterable[NamedBox]) -> None:
    for name, size, centre in boxes:
        write_body(link, name, Box(*size), centre, (0.0, 0.0, 0.0))
