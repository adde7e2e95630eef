"""Reads a robot description (URDF) strictly: what is not supported is refused by name, never mangled.

Supported: trees of ``revolute``, ``prismatic`` and ``fixed`` joints, and collision bodies of
``<sphere radius>``, ``<box size>``, ``<cylinder radius length>`` and, beyond the standard,
``<capsule radius length>`` (the length without its caps, axis along z), ``<cone radius length>`` (its tip at
+length/2) and ``<convex vertices radius>`` (the hull of points "x y z x y z …", thickened). A ``<mesh>`` is
cut into ``<convex>`` bodies before (``armgate.cell.mesh.urdf``), so that the text needs no other files.
Visuals, inertias and everything else that a gate does not need are ignored.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from armgate.cell.errors import ModelError
from armgate.cell.names import NAME_TEXT, is_name, is_part_name, whole_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Convex, Shape, shape_from

JointKind = Literal["revolute", "prismatic", "fixed"]
_KINDS: dict[str, JointKind] = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
_SIZES = {
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "cone": ("radius", "length"),
}
_SHAPES = "sphere, capsule, cylinder, box, cone, mesh or convex"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: its frame is ``origin`` in the frame of the parent link; limits in rad or m, and per s."""

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Placement
    axis: tuple[float, float, float]
    lower: float
    upper: float
    velocity: float


@dataclass(frozen=True)
class UrdfBody:
    """A collision body, placed in the frame of its link."""

    name: str
    link: str
    shape: Shape
    placement: Placement


@dataclass(frozen=True)
class Urdf:
    """A robot description: one tree of links."""

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    bodies: tuple[UrdfBody, ...]


def parse_xml(text: str) -> ET.Element:
    """The ``<robot>`` element of a URDF text.

    Raises:
        ModelError: No XML, a document type (entities could blow it up), or no ``<robot>``.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ModelError("a document type or entities are not allowed in a URDF; remove <!DOCTYPE …>")
    try:
        root = ET.fromstring(text)  # noqa: S314  (entities are refused above)
    except (ET.ParseError, ValueError) as error:
        raise ModelError(f"not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise ModelError(f"the outer element is <{root.tag}>; expected <robot>")
    return root


def read_urdf(text: str) -> Urdf:
    """Reads a URDF text.

    Raises:
        ModelError: It is malformed or holds something that is not supported; the text names the element.
    """
    root = parse_xml(text)
    links = tuple(_name(element, "link") for element in root.findall("link"))
    _refuse_doubles("link", links)
    joints = tuple(_joint(element, links) for element in root.findall("joint"))
    _refuse_doubles("joint", (joint.name for joint in joints))
    bodies = tuple(body for element in root.findall("link") for body in _bodies(element))
    _refuse_doubles("body", (body.name for body in bodies))
    wholes = {whole_name(body.name) for body in bodies if body.name != whole_name(body.name)}
    _refuse_doubles("body", [*wholes, *(body.name for body in bodies if body.name in wholes)])
    return Urdf(root.get("name", ""), _root_link(links, joints), links, joints, bodies)


def kinematics_only(text: str) -> str:
    """The same URDF with bare links and the joints' kinematics, as other parsers take it.

    They know no ``<capsule>``, stumble over inertias and insist on a name and on effort limits.
    """
    robot = parse_xml(text)
    robot.set("name", robot.get("name") or "robot")
    for element in list(robot):
        if element.tag not in {"link", "joint"}:
            robot.remove(element)
        for child in list(element):
            if element.tag == "link" or child.tag not in {"parent", "child", "origin", "axis", "limit"}:
                element.remove(child)
    for limit in robot.iter("limit"):
        limit.set("effort", "0")
    return ET.tostring(robot, encoding="unicode")


def _root_link(links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> str:
    if not links:
        raise ModelError("there is no <link>; expected at least one")
    children = [joint.child for joint in joints]
    _refuse_doubles("child link", children)
    roots = [link for link in links if link not in children]
    if not roots:
        raise ModelError("every link is the child of a joint: the joints form a loop; expected a tree")
    if len(roots) > 1:
        raise ModelError(f"links {', '.join(roots)} have no parent; expected exactly one root link")
    _refuse_loops(roots[0], links, joints)
    return roots[0]


def _refuse_loops(root: str, links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> None:
    reached, front = {root}, [root]
    while front:
        link = front.pop()
        children = [joint.child for joint in joints if joint.parent == link]
        reached.update(children)
        front.extend(children)
    lost = [link for link in links if link not in reached]
    if lost:
        raise ModelError(f"links {', '.join(lost)} are not connected to {root}: their joints form a loop")


def _refuse_doubles(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ModelError(f"{what} {name!r} occurs twice; expected every name once")
        seen.add(name)


def _name(element: ET.Element, what: str) -> str:
    name = element.get("name", "")
    if not is_name(name):
        raise ModelError(f"a {what} cannot be called {name!r}; expected {NAME_TEXT}")
    return name


def numbers(
    element: ET.Element, attribute: str, count: int, where: str, default: str | None = None
) -> list[float]:
    """The numbers in an attribute.

    Raises:
        ModelError: It is missing, or holds anything but ``count`` finite numbers; the text begins with
            ``where``.
    """
    text = element.get(attribute, default)
    if text is None:
        raise ModelError(f"{where}: <{element.tag}> lacks the attribute {attribute!r}")
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ModelError(
            f"{where}: {attribute}={text!r} in <{element.tag}>; expected {count} finite number(s)"
        )
    return values


def origin_of(element: ET.Element, where: str) -> tuple[list[float], list[float]]:
    """The ``<origin>`` in an element: xyz [m] and rpy [rad].

    Raises:
        ModelError: It holds something else than numbers; the text begins with ``where``.
    """
    origin = element.find("origin")
    if origin is None:
        return [0.0] * 3, [0.0] * 3
    zeros = "0 0 0"
    return numbers(origin, "xyz", 3, where, zeros), numbers(origin, "rpy", 3, where, zeros)


def _origin(element: ET.Element, where: str) -> Placement:
    return Placement.from_rpy(*origin_of(element, where))


# --- joints -----------------------------------------------------------------------------------------------


def _joint(element: ET.Element, links: tuple[str, ...]) -> UrdfJoint:
    name = _name(element, "joint")
    where = f"joint {name!r}"
    kind = _joint_kind(element, where)
    if element.find("mimic") is not None:
        raise ModelError(f"{where}: <mimic> joints are not supported; make it fixed or a joint of its own")
    parent, child = (_joint_link(element, end, links, where) for end in ("parent", "child"))
    origin = _origin(element, where)
    if kind == "fixed":
        return UrdfJoint(name, kind, parent, child, origin, (1.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    return UrdfJoint(name, kind, parent, child, origin, _axis(element, where), *_limits(element, where))


def _joint_kind(element: ET.Element, where: str) -> JointKind:
    kind = element.get("type", "")
    if kind in _KINDS:
        return _KINDS[kind]
    hint = "expected revolute, prismatic or fixed"
    if kind == "continuous":
        hint = "make it revolute with finite limits"
    raise ModelError(f"{where}: type {kind!r} is not supported; {hint}")


def _joint_link(element: ET.Element, end: str, links: tuple[str, ...], where: str) -> str:
    found = element.find(end)
    link = None if found is None else found.get("link")
    if link is None:
        raise ModelError(f"{where}: lacks <{end} link=…/>")
    if link not in links:
        raise ModelError(f"{where}: its {end} link {link!r} does not exist")
    return link


def _axis(element: ET.Element, where: str) -> tuple[float, float, float]:
    found = element.find("axis")
    x, y, z = (1.0, 0.0, 0.0) if found is None else numbers(found, "xyz", 3, where, "1 0 0")
    norm = math.hypot(x, y, z)
    if norm < 1e-9:
        raise ModelError(f"{where}: its axis is zero; expected a direction")
    return x / norm, y / norm, z / norm


def _limits(element: ET.Element, where: str) -> tuple[float, float, float]:
    limit = element.find("limit")
    if limit is None:
        raise ModelError(f"{where}: lacks <limit lower=… upper=… velocity=…/>")
    lower, upper, velocity = (
        numbers(limit, attribute, 1, where)[0] for attribute in ("lower", "upper", "velocity")
    )
    if lower >= upper:
        raise ModelError(f"{where}: lower limit {lower:g} is not below the upper limit {upper:g}")
    if velocity <= 0.0:
        raise ModelError(f"{where}: velocity limit {velocity:g}; expected more than 0")
    return lower, upper, velocity


# --- bodies -----------------------------------------------------------------------------------------------


def collisions(link: ET.Element) -> list[tuple[str, ET.Element]]:
    """The collision elements of a link with the names of their bodies.

    Raises:
        ModelError: A name is not possible.
    """
    name, named = _name(link, "link"), []
    for number, element in enumerate(link.findall("collision"), start=1):
        # A link may have several nameless collisions; the first takes the link's name.
        body = element.get("name", name if number == 1 else f"{name}_{number}")
        if not is_part_name(body):
            raise ModelError(f"link {name!r}: a body cannot be called {body!r}; expected {NAME_TEXT}")
        named.append((body, element))
    return named


def write_body(link: ET.Element, name: str, shape: Shape, xyz: Iterable[float], rpy: Iterable[float]) -> None:
    """Adds a collision body to a link, at an origin [m] and roll, pitch, yaw [rad] in the link's frame."""
    collision = ET.SubElement(link, "collision", name=name)
    ET.SubElement(collision, "origin", xyz=number_text(xyz), rpy=number_text(rpy))
    geometry = ET.SubElement(collision, "geometry")
    if isinstance(shape, Box):
        ET.SubElement(geometry, "box", size=number_text(shape.size))
    elif isinstance(shape, Convex):
        corners = number_text(value for vertex in shape.vertices for value in vertex)
        ET.SubElement(geometry, "convex", radius=repr(shape.radius), vertices=corners)
    else:
        sizes = zip(_SIZES[shape.kind], map(repr, shape.size), strict=True)
        ET.SubElement(geometry, shape.kind, dict(sizes))


def number_text(values: Iterable[float]) -> str:
    """Numbers as URDF writes them; reading gives the same numbers again."""
    return " ".join(repr(float(value)) for value in values)


def _bodies(link: ET.Element) -> list[UrdfBody]:
    bodies, name = [], link.get("name", "")
    for body, element in collisions(link):
        where = f"link {name!r}, body {body!r}"
        bodies.append(UrdfBody(body, name, _shape(element, where), _origin(element, where)))
    return bodies


def _shape(element: ET.Element, where: str) -> Shape:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise ModelError(f"{where}: expected one <geometry> with one shape in it")
    shape = geometry[0]
    try:
        return _convex(shape, where) if shape.tag == "convex" else shape_from(shape.tag, _sizes(shape, where))
    except ModelError as error:
        raise error if str(error).startswith(where) else ModelError(f"{where}: {error}") from error


def _sizes(shape: ET.Element, where: str) -> list[float]:
    if shape.tag == "box":
        return numbers(shape, "size", 3, where)
    if shape.tag in _SIZES:
        return [numbers(shape, attribute, 1, where)[0] for attribute in _SIZES[shape.tag]]
    if shape.tag == "mesh":
        raise ModelError(f"{where}: <mesh> names a file, not its content; load the URDF through a cell")
    raise ModelError(f"{where}: unknown shape <{shape.tag}>; expected {_SHAPES}")


def _convex(shape: ET.Element, where: str) -> Convex:
    count = len(shape.get("vertices", "").split())
    values = numbers(shape, "vertices", max(3, count - count % 3), where)
    (radius,) = numbers(shape, "radius", 1, where, "0")
    x, y, z = values[::3], values[1::3], values[2::3]
    return Convex(tuple(zip(x, y, z, strict=True)), radius)
