"""The monitor's own reader of a URDF: links, joints and collision bodies.

It rejects unsupported elements and attributes that affect the position, motion or shape of bodies, with their
names in the error. It ignores visuals, inertias, materials, transmissions and similar elements.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

import numpy as np

from armgate.monitor.convex_solid import SIZES, Solid, hull, primitive
from armgate.monitor.errors import DescriptionError
from armgate.monitor.files import read_bytes
from armgate.monitor.transforms import Array, from_quaternion, placement

MAX_BYTES = 16 << 20
VERSIONS = ("1.0", "1.1", "1.2")
_TURN = "quat_xyzw"
"""Attribute for the rotation of an origin, from version 1.1 on."""

_SIZE_KEYS = {
    "sphere": ("radius",), "capsule": ("radius", "length"), "cylinder": ("radius", "length"),
    "cone": ("radius", "length"), "box": ("size",),
}  # fmt: skip
_MOVING = ("revolute", "prismatic")


@dataclass(frozen=True, eq=False)
class Joint:
    """Joint; ``origin`` is its placement in the parent link's frame; limits in rad or m, per s, per s²."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    acceleration: float = math.inf
    deceleration: float = math.inf


@dataclass(frozen=True, eq=False)
class MeshUse:
    """Mesh of a collision body: the file name as in the URDF, and the factor per axis."""

    uri: str
    scale: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Body:
    """Collision body at ``origin`` in the frame of its link."""

    name: str
    link: str
    origin: Array
    shape: Solid | MeshUse


@dataclass(eq=False)
class Description:
    """Robot as one tree of links."""

    root: str
    links: list[str]
    joints: list[Joint] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)


def read_urdf(file: Path) -> Description:
    """Read a URDF file.

    Raises:
        DescriptionError: It cannot be read, or holds something that the monitor does not support.
    """
    try:
        return _description(_tree(read_bytes(file, MAX_BYTES, "").decode("utf-8")))
    except (expat.ExpatError, ValueError, AssertionError) as error:
        raise DescriptionError(f"{file}: not a URDF in UTF-8: {error}") from error
    except DescriptionError as error:
        raise error if str(error).startswith(str(file)) else DescriptionError(f"{file}: {error}") from error


def read_joints(data: bytes) -> list[Joint]:
    """Read the joints of a received URDF, and ignore its bodies.

    Raises:
        DescriptionError: It cannot be read, or holds a joint that the monitor does not support.
    """
    try:
        robot = _tree(data.decode("utf-8"))
    except (expat.ExpatError, ValueError, AssertionError) as error:
        raise DescriptionError(f"not a URDF in UTF-8: {error}") from error
    _check_form(robot)
    joints = _joints(robot, [_name(link) for link in robot.findall("link")])
    _check_unique("joint", [joint.name for joint in joints])
    return joints


def _tree(text: str) -> ET.Element:
    """Return the root element; names keep their namespace prefixes, declared or not."""
    tree, parser = ET.TreeBuilder(), expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        tree.start(tag, {key: v for key, v in attributes.items() if not key.startswith(("xmlns", "xml:"))})

    def refuse(*_: object) -> None:
        raise DescriptionError("a document type or entities are not allowed")

    parser.StartElementHandler, parser.EndElementHandler = start, tree.end
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(text, True)
    return tree.close()


def _description(robot: ET.Element) -> Description:
    _check_form(robot)
    found = Description("", [_name(link) for link in robot.findall("link")])
    for link in robot.findall("link"):
        found.bodies += _bodies(link)
    found.bodies = _with_unique_names(found.bodies)
    found.joints = _joints(robot, found.links)
    found.root = _root(found)
    return found


def _check_form(robot: ET.Element) -> None:
    """Reject another root element, and versions of URDF that the monitor does not support."""
    if robot.tag != "robot":
        raise DescriptionError(f"the root element is <{robot.tag}>; expected <robot>")
    version = robot.get("version", "1.0")
    if version not in VERSIONS:
        raise DescriptionError(f"the monitor does not support version {version!r} of URDF")
    origins = [*robot.iterfind("joint/origin"), *robot.iterfind("link/collision/origin")]
    if version == VERSIONS[0] and any(_TURN in origin.attrib for origin in origins):
        raise DescriptionError(f"{_TURN} needs version 1.1 of URDF")


def _joints(robot: ET.Element, links: list[str]) -> list[Joint]:
    return [_joint(element, links) for element in robot.findall("joint")]


def _with_unique_names(bodies: list[Body]) -> list[Body]:
    """Return the bodies; a name that several links use is preceded by that of its link."""
    links: dict[str, set[str]] = {}
    for body in bodies:
        links.setdefault(body.name, set()).add(body.link)
    return [b if len(links[b.name]) == 1 else replace(b, name=f"{b.link}.{b.name}") for b in bodies]


def _root(found: Description) -> str:
    """Return the link that is not a child; all others must be reachable from it."""
    _check_unique("link", found.links)
    _check_unique("joint", [joint.name for joint in found.joints])
    _check_unique("child link", [joint.child for joint in found.joints])
    roots = set(found.links) - {joint.child for joint in found.joints}
    if len(roots) != 1 or len(found.joints) != len(found.links) - 1:
        raise DescriptionError("the links are not one tree with one root")
    reached, front = set(roots), list(roots)
    while front:
        link = front.pop()
        front += [joint.child for joint in found.joints if joint.parent == link]
        reached.update(front)
    if len(reached) != len(found.links):
        raise DescriptionError("the joints form a loop")
    return roots.pop()


def _check_unique(what: str, names: list[str]) -> None:
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise DescriptionError(f"{what} {min(twice)!r} occurs twice")


def _name(element: ET.Element) -> str:
    name = element.get("name", "")
    if not name:
        raise DescriptionError(f"a <{element.tag}> has no name")
    return name


def _numbers(element: ET.Element, key: str, count: int, default: str | None = None) -> list[float]:
    text = element.get(key, default)
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise DescriptionError(f"<{element.tag}> {key}={text!r}; expected {count} finite numbers")
    return values


def _only(element: ET.Element, attributes: set[str]) -> None:
    """Reject attributes that the monitor does not support."""
    unknown = set(element.attrib) - attributes
    if unknown:
        raise DescriptionError(
            f"<{element.tag}> has the attribute {min(unknown)!r}, not supported by the monitor"
        )


def _origin(element: ET.Element) -> Array:
    origins = element.findall("origin")
    if not origins:
        return np.eye(4)
    if len(origins) > 1:
        raise DescriptionError(f"<{element.tag}> has {len(origins)} origins")
    _only(origins[0], {"xyz", "rpy", _TURN})
    if _TURN in origins[0].attrib:
        return _quaternion_origin(origins[0])
    return placement(_numbers(origins[0], "xyz", 3, "0 0 0"), _numbers(origins[0], "rpy", 3, "0 0 0"))


def _quaternion_origin(origin: ET.Element) -> Array:
    if "rpy" in origin.attrib:
        raise DescriptionError(f"an <origin> has rpy and {_TURN}")
    turn = np.array(_numbers(origin, _TURN, 4))
    length = float(np.linalg.norm(turn))
    if abs(length - 1.0) > 1e-3:
        raise DescriptionError(f"{_TURN} of length {length:g}; expected length 1")
    return from_quaternion(_numbers(origin, "xyz", 3, "0 0 0"), (turn / length).tolist())


def _joint(element: ET.Element, links: list[str]) -> Joint:
    name, kind = _name(element), element.get("type", "")
    if kind not in (*_MOVING, "fixed") or element.find("mimic") is not None:
        what = "a <mimic> joint" if element.find("mimic") is not None else f"of type {kind!r}"
        raise DescriptionError(f"joint {name!r} is {what}, which the monitor does not support")
    parent, child = (_link_of(element, end, name, links) for end in ("parent", "child"))
    if kind == "fixed":
        return Joint(name, kind, parent, child, _origin(element), np.array([1.0, 0.0, 0.0]))
    axis_element, limit = element.find("axis"), element.find("limit")
    axis = np.array([1.0, 0.0, 0.0] if axis_element is None else _numbers(axis_element, "xyz", 3, "1 0 0"))
    length = float(np.linalg.norm(axis))
    if limit is None or length < 1e-9:
        raise DescriptionError(f"joint {name!r} has no <limit>, or no axis")
    lower, upper, velocity = (_numbers(limit, key, 1)[0] for key in ("lower", "upper", "velocity"))
    ramp = _numbers(limit, "acceleration", 1, "0")[0] or math.inf
    brake = _numbers(limit, "deceleration", 1, "0")[0] or ramp
    origin = _origin(element)
    return Joint(name, kind, parent, child, origin, axis / length, lower, upper, velocity, ramp, brake)


def _link_of(element: ET.Element, end: str, joint: str, links: list[str]) -> str:
    found = element.find(end)
    link = "" if found is None else found.get("link", "")
    if link not in links:
        raise DescriptionError(f"joint {joint!r}: its {end} link {link!r} does not exist")
    return link


def _bodies(link: ET.Element) -> list[Body]:
    """Return the bodies of a link; nameless ones get unused names."""
    bodies, elements = [], link.findall("collision")
    given = {element.get("name") for element in elements}
    for number, element in enumerate(elements, start=1):
        nameless = _name(link) if number == 1 else f"{_name(link)}_{number}"
        while nameless in given:
            nameless += "_"
        name = element.get("name", nameless)
        bodies.append(Body(name, _name(link), _origin(element), _shape(element, name)))
    return bodies


def _shape(element: ET.Element, body: str) -> Solid | MeshUse:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise DescriptionError(f"body {body!r}: expected one <geometry> with one shape in it")
    shape = geometry[0]
    if shape.tag == "mesh":
        x, y, z = _numbers(shape, "scale", 3, "1 1 1")
        return MeshUse(shape.get("filename", ""), (x, y, z))
    if shape.tag == "convex":
        count = len(shape.get("vertices", "").split())
        values = np.array(_numbers(shape, "vertices", count)).reshape(-1, 3)
        return hull(values, _numbers(shape, "radius", 1, "0")[0])
    keys = _SIZE_KEYS.get(shape.tag)
    if keys is None:
        raise DescriptionError(f"body {body!r}: the monitor does not support the shape <{shape.tag}>")
    if shape.tag == "box":
        return primitive("box", _numbers(shape, "size", SIZES["box"]), f"body {body!r}")
    return primitive(shape.tag, [_numbers(shape, key, 1)[0] for key in keys], f"body {body!r}")
