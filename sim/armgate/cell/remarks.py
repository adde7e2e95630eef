"""Warnings about a cell: parts that nothing guards, and limits that the gate ignores."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from armgate.cell.cell import Cell, Robot
from armgate.cell.urdf_xml import parse_xml


def remarks(cell: Cell) -> list[str]:
    """Return the warnings about a cell, a line each."""
    found = [text for robot in cell.robots for text in _about_robot(robot)]
    if not cell.pairs:
        found.append(
            "no pair of bodies must stay apart: the gate keeps joint limits only; configure surroundings, or "
            "give the robots' links collision bodies"
        )
    return found


def _about_robot(robot: Robot) -> Iterator[str]:
    urdf = parse_xml(robot.urdf)
    if not any(body.joint >= 0 for body in robot.model.bodies):
        yield f"{robot.name}: none of its moving links has a body: nothing keeps the robot from a collision"
    seen = _unguarded(urdf, robot)
    if seen:
        yield (
            f"{robot.name}: {_listed('link', seen)} visuals, but no collision body: nothing guards that "
            f"part; add <collision> to the URDF, or bodies to the configuration"
        )
    jerky = [
        joint.get("name", "") for joint in urdf.findall("joint") if joint.find("limit[@jerk]") is not None
    ]
    if jerky:
        yield (
            f"{robot.name}: {_listed('joint', jerky)} a jerk limit, which the gate ignores; configure "
            f"decelerations that the robot reaches in spite of it"
        )


def _unguarded(urdf: ET.Element, robot: Robot) -> list[str]:
    guarded = {body.link for body in robot.model.bodies}
    names = [link.get("name", "") for link in urdf.findall("link") if link.find("visual") is not None]
    return [name for name in names if name not in guarded]


def _listed(what: str, names: list[str]) -> str:
    return f"{what} {names[0]} has" if len(names) == 1 else f"{what}s {', '.join(names)} have"
