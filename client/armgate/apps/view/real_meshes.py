"""Real meshes of the KUKA KR 16-2, from the optional extra ``meshes``; without it none, and no error.

The package ``rtb-data`` brings the visual meshes of ROS-Industrial's ``kuka_kr16_support``. They are drawn
where a robot has that arm's joints: the same axes at the same places between links of the same names.
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
"""Joints are the same if origins and axes differ by no more, m and unit of direction."""
BLACK = 40
"""What is no lighter than this in any colour is black in the meshes; the rest is the arm's paint."""
_ARM = Path("xacro", "kuka_description", "kuka_kr16")


def real_meshes(urdf: str) -> Found:
    """By link: colour (None for that of an arm of primitives) and mesh."""
    folder = _folder()
    if folder is None:
        return {}
    arm = _joints((folder / "urdf" / "kr16_2.urdf").read_text(encoding="utf-8"))
    if not _has(_joints(urdf), arm):
        return {}
    visual = folder / "meshes" / "kr16_2" / "visual"
    return {link: list(_read(visual / f"{link}.dae")) for link in ("base_link", *arm)}


def bodies_of(urdf: str) -> set[tuple[str, str]]:
    """Link and name of the bodies that the URDF itself has; real meshes stand for these and no others."""
    return {
        (link.get("name", ""), body.get("name", link.get("name", "")))
        for link in parse_xml(urdf).iter("link")
        for body in link.iter("collision")
    }


def _folder() -> Path | None:
    """Where the arm is; None unless the extra is installed."""
    spec = find_spec("rtbdata")
    if spec is None or spec.origin is None or find_spec("collada") is None:
        return None
    folder = Path(spec.origin).parent / _ARM
    return folder if folder.is_dir() else None


def _joints(urdf: str) -> Joints:
    """Origin (xyz, rpy) and axis of each joint that turns, by the link that it moves."""
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
