"""Vocabulary of robot descriptions: elements and attributes that are read or ignored; all others are refused.

docs/configuration.md lists the ignored ones; a test compares that list with ``FORMS``.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from armgate.cell.urdf.xml_tree import line_prefix

VERSIONS = ("1.0", "1.1", "1.2")
_XACRO = "http://www.ros.org/wiki/xacro", "http://wiki.ros.org/xacro", "http://ros.org/wiki/xacro"
_HINTS = {
    "self_collision_checking": ": remove it; the shapes in <collision> are checked against the robot itself"
}
"""Remedies for elements of earlier URDF versions."""


@dataclass(frozen=True)
class Form:
    """Content that an element may have.

    Attributes:
        attributes: Attributes that are read.
        once: Elements that are read, at most one of each.
        many: Elements that are read, any number.
        ignored: Elements that are ignored with all their content.
        ignored_attributes: Attributes that are ignored.
    """

    attributes: tuple[str, ...] = ()
    once: tuple[str, ...] = ()
    many: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    ignored_attributes: tuple[str, ...] = ()


FORMS: dict[str, Form] = {
    "robot": Form(
        ("name", "version"),
        many=("link", "joint"),
        ignored=(
            "material", "transmission", "gazebo", "ros2_control", "sensor", "mujoco",
            "drake:collision_filter_group",
        ),
    ),
    "link": Form(("name",), many=("collision",), ignored=("visual", "inertial", "contact")),
    "collision": Form(
        ("name",),
        once=("origin", "geometry"),
        ignored=("material", "verbose", "contact_coefficients", "drake:proximity_properties"),
    ),
    "geometry": Form(many=("sphere", "box", "cylinder", "capsule", "cone", "convex", "mesh")),
    "joint": Form(
        ("name", "type"),
        once=("parent", "child", "origin", "axis", "limit", "mimic"),
        ignored=("calibration", "dynamics", "safety_controller", "drake:controller_gains"),
    ),
    "origin": Form(("xyz", "rpy", "quat_xyzw")),
    "parent": Form(("link",)),
    "child": Form(("link",)),
    "axis": Form(("xyz",)),
    "limit": Form(
        ("lower", "upper", "velocity", "acceleration", "deceleration"), ignored_attributes=("effort", "jerk")
    ),
    "mimic": Form(("joint", "multiplier", "offset")),
    "sphere": Form(("radius",)),
    "box": Form(("size",)),
    "cylinder": Form(("radius", "length")),
    "capsule": Form(("radius", "length")),
    "cone": Form(("radius", "length")),
    "convex": Form(("vertices", "radius")),
    "mesh": Form(("filename", "scale"), ignored=("drake:declare_convex",)),
}  # fmt: skip


def unknown_words(robot: ET.Element) -> Iterator[str]:
    """Yield an error for everything in a ``<robot>`` element that is neither read nor listed as ignored."""
    prefixes = {"xacro"} | {
        key.partition(":")[2] for key, uri in robot.attrib.items() if uri.rstrip("/") in _XACRO
    }
    for element in robot.iter():
        prefix, colon, _ = element.tag.partition(":")
        if colon and prefix in prefixes:
            yield (
                f"{line_prefix(element)}<{element.tag}> is left over from xacro; expand the file first: "
                f"xacro ROBOT.urdf.xacro > ROBOT.urdf"
            )
    yield from _unknown_in(robot, "", prefixes)


def _unknown_in(element: ET.Element, owner: str, prefixes: set[str]) -> Iterator[str]:
    form, tag = FORMS[element.tag], element.tag
    if tag in ("link", "joint"):
        owner = f"{tag} {element.get('name')!r}: "
    where = f"{line_prefix(element)}{owner}"
    for key in element.attrib:
        known = (*form.attributes, *form.ignored_attributes)
        if key not in known and key != "xmlns" and not key.startswith(("xmlns:", "xml:")):
            expected = f"expected {', '.join(known)}" if known else "expected none"
            yield f"{where}the attribute {key!r} of <{tag}> is not supported; {expected}"
    if any((text or "").strip() for text in (element.text, *(child.tail for child in element))):
        yield f"{where}text in <{tag}>; expected elements and attributes only"
    yield from _unknown_children(element, owner, prefixes)


def _unknown_children(element: ET.Element, owner: str, prefixes: set[str]) -> Iterator[str]:
    form, tag, seen = FORMS[element.tag], element.tag, set()
    for child in element:
        where = f"{line_prefix(child)}{owner}"
        if child.tag in form.ignored or child.tag.partition(":")[0] in prefixes:
            continue
        if child.tag in form.once and child.tag in seen:
            yield f"{where}<{child.tag}> occurs again in <{tag}>; expected it once"
        elif child.tag in (*form.once, *form.many):
            seen.add(child.tag)
            yield from _unknown_in(child, owner, prefixes)
        elif tag != "geometry":  # an unknown shape is refused by the reader of shapes
            known = ", ".join((*form.once, *form.many, *form.ignored)) or "nothing"
            hint = _HINTS.get(child.tag, "")
            yield f"{where}<{child.tag}> in <{tag}> is not supported; expected {known}{hint}"
