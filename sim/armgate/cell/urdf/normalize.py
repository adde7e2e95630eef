"""Simplification of a robot description for other parsers."""

import xml.etree.ElementTree as ET

from armgate.cell.urdf.elements import number_text, origin_of
from armgate.cell.urdf.xml_tree import parse_xml


def kinematics_only(text: str) -> str:
    """Return the same URDF with bare links and the kinematics of the joints.

    Other parsers do not know ``<capsule>``, reject some inertias, and require a name and effort limits.
    """
    robot = parse_xml(text)
    replace_quaternions(robot)
    bare = ET.Element("robot", name=robot.get("name") or "robot")
    for element in [*robot.findall("link"), *robot.findall("joint")]:
        own = ET.SubElement(bare, element.tag, element.attrib)
        for child in element if element.tag == "joint" else ():
            if child.tag in {"parent", "child", "origin", "axis"}:
                own.append(child)
            elif child.tag == "limit":
                bounds = {key: child.get(key, "0") for key in ("lower", "upper", "velocity")}
                ET.SubElement(own, "limit", bounds, effort="0")
    return ET.tostring(bare, encoding="unicode")


def replace_quaternions(robot: ET.Element) -> None:
    """Replace the quaternions of joints and collisions by roll, pitch, yaw, which every parser reads.

    Raises:
        ModelError: A quaternion is refused.
    """
    for element in [*robot.findall("joint"), *robot.findall("link/collision")]:
        origin = element.find("origin")
        if origin is not None and "quat_xyzw" in origin.attrib:
            _, rpy = origin_of(element, element.tag)
            del origin.attrib["quat_xyzw"]
            origin.set("rpy", number_text(rpy))
