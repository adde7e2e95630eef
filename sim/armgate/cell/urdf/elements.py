"""Elements of a robot description: numbers and origins in their attributes; new links and joints."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

from armgate.cell.errors import ModelError
from armgate.cell.names import NAME_TEXT, is_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import MAX_EXTENT

MAX_NUMBER = 1e9
"""Largest number, in any unit."""

_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
"""Form of a number; Python's float() also accepts 1_000 and digits of other scripts."""

_UNIT_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1."""


def name_of(element: ET.Element, kind: str) -> str:
    """Return the name of a link or joint.

    Raises:
        ModelError: The name is not valid.
    """
    name = element.get("name", "")
    if not is_name(name):
        raise ModelError(f"a {kind} cannot be called {name!r}; expected {NAME_TEXT}")
    return name


def unique(name: str, kind: str, names: Iterable[str]) -> str:
    """Return a name that is not among ``names``.

    Raises:
        ModelError: The name is taken.
    """
    if name in names:
        raise ModelError(f"{kind} {name!r} occurs twice; expected every name once")
    return name


def numbers(
    element: ET.Element, attribute: str, count: int, where: str, default: str | None = None
) -> list[float]:
    """Return the numbers in an attribute.

    Raises:
        ModelError: The attribute is missing, or is anything but ``count`` finite numbers; the text begins
            with ``where``.
    """
    text = element.get(attribute, default)
    if text is None:
        raise ModelError(f"{where}: <{element.tag}> lacks the attribute {attribute!r}")
    parts = text.split() if text.isascii() else [text]
    values = [float(part) for part in parts] if all(map(_NUMBER.fullmatch, parts)) else []
    if len(values) != count or not all(abs(value) <= MAX_NUMBER for value in values):
        shown = text if len(text) <= 60 else text[:57] + "..."
        raise ModelError(
            f"{where}: {attribute}={shown!r} in <{element.tag}>; expected {count} finite number(s) within "
            f"±{MAX_NUMBER:g}"
        )
    return values


def origin_of(element: ET.Element, where: str) -> tuple[list[float], list[float]]:
    """Return xyz [m] and rpy [rad] of the ``<origin>`` in an element; zeros if it has none.

    Raises:
        ModelError: It contains something other than numbers, or two rotations; the text begins with
            ``where``.
    """
    origin = element.find("origin")
    if origin is None:
        return [0.0] * 3, [0.0] * 3
    zeros = "0 0 0"
    xyz = numbers(origin, "xyz", 3, where, zeros)
    if max(map(abs, xyz)) > MAX_EXTENT:
        raise ModelError(f"{where}: an origin beyond {MAX_EXTENT:g} m; expected metres")
    if "quat_xyzw" not in origin.attrib:
        return xyz, numbers(origin, "rpy", 3, where, zeros)
    if "rpy" in origin.attrib:
        raise ModelError(f"{where}: <origin> has rpy and quat_xyzw; expected one of them")
    return xyz, _rpy_of_quaternion(origin, where)


def _rpy_of_quaternion(origin: ET.Element, where: str) -> list[float]:
    x, y, z, w = numbers(origin, "quat_xyzw", 4, where)
    length = math.hypot(x, y, z, w)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ModelError(f"{where}: quat_xyzw of length {length:g}; expected length 1")
    return list(Placement.from_quaternion((0.0, 0.0, 0.0), (x, y, z, w)).rpy())


def placement_of(element: ET.Element, where: str) -> Placement:
    """Return the ``<origin>`` in an element as a placement, see ``origin_of``."""
    return Placement.from_rpy(*origin_of(element, where))


def number_text(values: Iterable[float]) -> str:
    """Return numbers in the form of URDF; reading it gives the same numbers again."""
    return " ".join(repr(float(value)) for value in values)


def add_link(robot: ET.Element, name: str) -> ET.Element:
    """Add a link.

    Raises:
        ModelError: The name is taken.
    """
    if any(link.get("name") == name for link in robot.findall("link")):
        raise ModelError(f"link {name!r} exists already; expected another name for the frame")
    return ET.SubElement(robot, "link", name=name)


def require_link(robot: ET.Element, name: str) -> ET.Element:
    """Return the link of this name.

    Raises:
        ModelError: There is no such link.
    """
    links = {link.get("name", ""): link for link in robot.findall("link")}
    if name not in links:
        raise ModelError(f"there is no link {name!r}; expected one of {', '.join(links)}")
    return links[name]


def add_joint(
    robot: ET.Element,
    name: str,
    kind: str,
    links: tuple[str, str],
    origin: tuple[Sequence[float], Sequence[float]] | None = None,
) -> ET.Element:
    """Add a joint between a parent and a child link, at an origin of xyz [m] and rpy [rad]."""
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    if origin is not None:
        xyz, rpy = origin
        ET.SubElement(joint, "origin", xyz=number_text(xyz), rpy=number_text(rpy))
    return joint
