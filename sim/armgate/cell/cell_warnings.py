"""Warnings about a cell: parts without collision bodies, and limits that the gate ignores."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from armgate.cell.cell import Cell, Robot
from armgate.cell.urdf.xml_tree import parse_xml


def cell_warnings(cell: Cell) -> list[str]:
    """Return the warnings about a cell, one line each."""
    warnings = [text for robot in cell.robots for text in _robot_warnings(robot)]
    if not cell.pairs:
        warnings.append(
            "no pair of bodies must stay apart: the gate checks joint limits only; configure surroundings, "
            "or give the robots' links collision bodies"
        )
    return warnings


def _robot_warnings(robot: Robot) -> Iterator[str]:
    urdf = parse_xml(robot.urdf)
    if not any(body.joint >= 0 for body in robot.model.bodies):
        yield f"{robot.name}: no moving link has a body: the gate cannot prevent collisions of this robot"
    visible = _links_without_bodies(urdf, robot)
    if visible:
        yield (
            f"{robot.name}: {_list_names('link', visible)} visuals but no collision body: the gate does not "
            f"check it; add <collision> to the URDF, or bodies to the configuration"
        )
    jerk_limited = [
        joint.get("name", "") for joint in urdf.findall("joint") if joint.find("limit[@jerk]") is not None
    ]
    if jerk_limited:
        yield (
            f"{robot.name}: {_list_names('joint', jerk_limited)} a jerk limit, which the gate ignores; "
            f"configure decelerations that the robot reaches within its jerk limits"
        )


def _links_without_bodies(urdf: ET.Element, robot: Robot) -> list[str]:
    with_bodies = {body.link for body in robot.model.bodies}
    names = [link.get("name", "") for link in urdf.findall("link") if link.find("visual") is not None]
    return [name for name in names if name not in with_bodies]


def _list_names(kind: str, names: list[str]) -> str:
    return f"{kind} {names[0]} has" if len(names) == 1 else f"{kind}s {', '.join(names)} have"
