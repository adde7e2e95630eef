"""Adds to an arm's URDF what the configuration does: a gantry, frames and bodies. The result is one URDF.

The gantry's joints X, Y, Z are the place of its carriage in the gantry's frame, so with the gantry's base at
the world's origin they read as world coordinates. The carriage is the lower end of a vertical column; the
arm's root link is fixed to it by ``mount``. The column is one solid piece that rises above the bridge (a
telescope takes less room, so this is on the safe side).
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.parts import Part, add_parts
from armgate.cell.shapes import Box
from armgate.cell.urdf import Urdf, number_text, read_robot, write_body

if TYPE_CHECKING:
    from armgate.cell.config import BodyConfig, FrameConfig, GantryConfig, Pose

GANTRY_LINKS = ("gantry", "gantry_x", "gantry_y", "gantry_z")
GANTRY_JOINTS = ("X", "Y", "Z")
_GAP = 0.1
"""Between the column and the bridge beside it, m."""

Triple = tuple[float, float, float]


def add_frame(robot: ET.Element, name: str, frame: "FrameConfig") -> None:
    """Adds a link ``name``, fixed in the frame of its parent link.

    Raises:
        ModelError: The parent does not exist, or the name is taken.
    """
    _require_link(robot, frame.parent)
    _add_link(robot, name)
    _add_joint(robot, f"{name}_mount", "fixed", frame.parent, name, pose=frame)
    _check(robot)


def add_body(robot: ET.Element, name: str, body: "BodyConfig", parts: Sequence[Part]) -> None:
    """Adds a body, which consists of these parts, to a link.

    Raises:
        ModelError: The link does not exist, or the name is taken.
    """
    add_parts(_require_link(robot, body.link), name, parts, body.xyz, body.rpy)
    _check(robot)


def add_gantry(robot: ET.Element, gantry: "GantryConfig") -> None:
    """Hangs a robot from a gantry: its links and joints keep their names.

    Raises:
        ModelError: The robot is refused, or already has a link or joint with a name of the gantry.
    """
    arm_root = _check(robot).root
    taken = {element.get("name", "") for element in robot} & {*GANTRY_LINKS, *GANTRY_JOINTS}
    if taken:
        raise ModelError(f"the arm uses the gantry's names {', '.join(sorted(taken))}; expected others")
    base, x, y, z = (_add_link(robot, name) for name in GANTRY_LINKS)
    _add_boxes(base, _portal(gantry))
    _add_boxes(x, [_bridge(gantry)])
    _add_boxes(y, [_trolley(gantry)])
    _add_boxes(z, [_column(gantry)])
    travels = (gantry.travel.x, gantry.travel.y, gantry.travel.z)
    axes: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for number, (name, axis, travel) in enumerate(zip(GANTRY_JOINTS, axes, travels, strict=True)):
        joint = _add_joint(robot, name, "prismatic", GANTRY_LINKS[number], GANTRY_LINKS[number + 1])
        ET.SubElement(joint, "axis", xyz=number_text(axis))
        limits = {"lower": travel[0], "upper": travel[1], "velocity": gantry.speed, "effort": 0.0}
        ET.SubElement(joint, "limit", {key: number_text((value,)) for key, value in limits.items()})
    _add_joint(robot, "gantry_mount", "fixed", GANTRY_LINKS[-1], arm_root, pose=gantry.mount)
    _check(robot)


def _check(robot: ET.Element) -> Urdf:
    """Names can collide with the arm's: the reader's own rules find that."""
    return read_robot(robot)


# --- the gantry's bodies: boxes (name, size, centre) in the frames of their links -------------------------

NamedBox = tuple[str, Triple, Triple]


def _portal(gantry: "GantryConfig") -> list[NamedBox]:
    """Two rails along x, each on two posts."""
    lower, upper = gantry.travel.x
    beam, side = gantry.beam, gantry.span / 2
    ends = (lower - 2 * beam, upper + 3 * beam)
    length, middle = ends[1] - ends[0], (ends[0] + ends[1]) / 2
    boxes: list[NamedBox] = []
    for word, y in (("left", side), ("right", -side)):
        rail_size, rail_centre = (length, beam, beam), (middle, y, gantry.height + beam / 2)
        boxes.append((f"gantry_rail_{word}", rail_size, rail_centre))
        for place, x in (("front", ends[0]), ("back", ends[1])):
            post_size, post_centre = (beam, beam, gantry.height), (x, y, gantry.height / 2)
            boxes.append((f"gantry_post_{word}_{place}", post_size, post_centre))
    return boxes


def _bridge(gantry: "GantryConfig") -> NamedBox:
    """The beam along y; it runs beside the column, on its +x side."""
    beam = gantry.beam
    return "gantry_bridge", (beam, gantry.span, beam), (_bridge_x(gantry), 0.0, gantry.height + beam / 2)


def _bridge_x(gantry: "GantryConfig") -> float:
    return gantry.column / 2 + _GAP + gantry.beam / 2


def _trolley(gantry: "GantryConfig") -> NamedBox:
    """Embraces column and bridge, on top of the bridge."""
    behind = _bridge_x(gantry) + gantry.beam / 2
    front = -gantry.column / 2 - _GAP / 2
    height = gantry.beam / 2
    centre = ((front + behind) / 2, 0.0, gantry.height + gantry.beam + height / 2)
    return "gantry_trolley", (behind - front, gantry.column + _GAP, height), centre


def _column(gantry: "GantryConfig") -> NamedBox:
    """Long enough to reach the trolley from the lowest carriage."""
    length = gantry.height + 1.5 * gantry.beam - gantry.travel.z[0]
    return "gantry_column", (gantry.column, gantry.column, length), (0.0, 0.0, length / 2)


# --- elements ---------------------------------------------------------------------------------------------


def _add_link(robot: ET.Element, name: str) -> ET.Element:
    if any(link.get("name") == name for link in robot.findall("link")):
        raise ModelError(f"link {name!r} exists already; expected another name for the frame")
    return ET.SubElement(robot, "link", name=name)


def _require_link(robot: ET.Element, name: str) -> ET.Element:
    links = {link.get("name", ""): link for link in robot.findall("link")}
    if name not in links:
        raise ModelError(f"there is no link {name!r}; expected one of {', '.join(links)}")
    return links[name]


def _add_joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, *, pose: "Pose | None" = None
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    if pose is not None:
        ET.SubElement(joint, "origin", xyz=number_text(pose.xyz), rpy=number_text(pose.rpy))
    return joint


def _add_boxes(link: ET.Element, boxes: Iterable[NamedBox]) -> None:
    for name, size, centre in boxes:
        write_body(link, name, Box(*size), centre, (0.0, 0.0, 0.0))
