"""Real meshes of the KUKA KR 16-2, from the optional extra ``meshes``; none if it is not installed.

The package ``rtb-data`` contains the visual meshes of ROS-Industrial's ``kuka_kr16_support``. They are drawn
if a robot has the joints of that arm, with the same origins and axes, between links with the same names.
"""

import math
import xml.etree.ElementTree as ET
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from armgate.apps.view import colours
from armgate.apps.view.shapes import Mesh
from armgate.cell.urdf import parse_xml

Found = dict[str, list[tuple[colours.RGB | None, Mesh]]]
Joints = dict[str, tuple[float, ...]]

SAME = 1e-3
"""Distance of origin (m, rad) and axis (unit vector) below which two joints count as equal."""
BLACK = 40
"""Colour components below which a part is drawn black; other parts are drawn in the colour of the arm."""
_ARM = Path("xacro", "kuka_description", "kuka_kr16")


def real_meshes(urdf: str) -> Found:
    """Return colour (None for the colour of an arm of primitives) and mesh, by link."""
    folder = _folder()
    if folder is None:
        return {}
    arm = _joints((folder / "urdf" / "kr16_2.urdf").read_text(encoding="utf-8"))
    if not _has(_joints(urdf), arm):
        return {}
    visual = folder / "meshes" / "kr16_2" / "visual"
    return {link: list(_read(visual / f"{link}.dae")) for link in ("base_link", *arm)}


def bodies_of(urdf: str) -> set[tuple[str, str]]:
    """Return link and name of the URDF's own bodies; real meshes replace these bodies only."""
    return {
        (link.get("name", ""), body.get("name", link.get("name", "")))
        for link in parse_xml(urdf).iter("link")
        for body in link.iter("collision")
    }


def _folder() -> Path | None:
    """Return the folder of the arm; None unless the extra is installed."""
    spec = find_spec("rtbdata")
    if spec is None or spec.origin is None or find_spec("collada") is None:
        return None
    folder = Path(spec.origin).parent / _ARM
    return folder if folder.is_dir() else None


def _joints(urdf: str) -> Joints:
    """Return origin (xyz, rpy) and axis of each revolute joint, by the link that it moves."""
    found = {}
    for joint in parse_xml(urdf).iter("joint"):
        child = joint.find("child")
        if joint.get("type") == "revolute" and child is not None:
            origin = joint.find("origin")
            found[child.get("link", "")] = (
                *_numbers(origin, "xyz", "0 0 0"), *_numbers(origin, "rpy", "0 0 0"),
                *_numbers(joint.find("axis"), "xyz", "1 0 0"),
            )  # fmt: skip
    return found


def _numbers(element: ET.Element | None, name: str, default: str) -> tuple[float, ...]:
    text = default if element is None else element.get(name, default)
    return tuple(float(word) for word in text.split())


def _has(robot: Joints, arm: Joints) -> bool:
    return all(link in robot and math.dist(robot[link], joint) < SAME for link, joint in arm.items())


@cache
def _read(file: Path) -> tuple[tuple[colours.RGB | None, Mesh], ...]:
    import trimesh

    return tuple((_colour(part), _mesh(part)) for part in trimesh.load_scene(file).dump())


def _mesh(part: Any) -> Mesh:
    vertices, normals = np.array(part.vertices, dtype=float), np.array(part.vertex_normals, dtype=float)
    return Mesh(vertices, normals, np.array(part.faces, dtype=np.int64), np.zeros((0, 2, 3)))


def _colour(part: Any) -> colours.RGB | None:
    colour = part.visual.material.main_color[:3]
    return colours.BLACK if max(colour) < BLACK else None
