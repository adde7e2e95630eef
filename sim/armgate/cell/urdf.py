"""Strict reader of robot descriptions (URDF): what is not supported is refused by name, never mangled.

Supported: trees of ``revolute``, ``prismatic`` and ``fixed`` joints, and collision bodies of
``<sphere radius>``, ``<box size>``, ``<cylinder radius length>`` and, beyond the standard,
``<capsule radius length>`` (the length without its caps, axis along z), ``<cone radius length>`` (its tip at
+length/2) and ``<convex vertices radius>`` (the hull of points "x y z x y z …", thickened). A ``<mesh>`` is
cut into ``<convex>`` bodies before (``armgate.cell.mesh.urdf``), so that the text needs no other files.
``urdf_words`` says which elements and attributes are read and which are ignored; all others are refused.
All findings of a description are reported together.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from armgate.cell.errors import ModelError
from armgate.cell.names import NAME_TEXT, is_name, is_part_name, whole_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Convex, Shape, shape_from
from armgate.cell.units import MAX_EXTENT
from armgate.cell.urdf_words import VERSIONS, unread
from armgate.cell.urdf_xml import parse_xml, place

__all__ = ["Urdf", "UrdfBody", "UrdfJoint", "parse_xml", "read_robot", "read_urdf"]

JointKind = Literal["revolute", "prismatic", "fixed"]
_KINDS: dict[str, JointKind] = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
_SIZES = {
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "cone": ("radius", "length"),
}
MAX_NUMBER = 1e9
"""Largest number, in whatever unit."""

MAX_LINKS = 256
MAX_BODIES = 4096
"""Most links, joints and bodies of a description: the protocol describes no more."""

_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
"""Form of a number; Python would read more, as 1_000 or digits of other scripts."""

_UNIT = 1e-3
"""Largest deviation of a quaternion's length from 1."""

_SHAPES = "sphere, capsule, cylinder, box, cone, mesh or convex"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: its frame is ``origin`` in the frame of the parent link; limits in rad or m, per s, per s².

    ``acceleration`` and ``deceleration`` are inf if the description has none.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Placement
    axis: tuple[float, float, float]
    lower: float
    upper: float
    velocity: float
    acceleration: float = math.inf
    deceleration: float = math.inf


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


class _Findings:
    """Findings of one description, to be raised together."""

    def __init__(self, texts: Iterable[str]) -> None:
        self.texts = list(texts)

    @contextmanager
    def collecting(self, element: ET.Element) -> Iterator[None]:
        """Take up a ModelError about an element."""
        try:
            yield
        except ModelError as error:
            self.texts.append(f"{place(element)}{error}")

    def check(self) -> None:
        """Raise all findings as one ModelError, a line each."""
        if self.texts:
            raise ModelError("\n".join(dict.fromkeys(self.texts)))


def read_urdf(text: str) -> Urdf:
    """Read a URDF text, see ``read_robot``."""
    return read_robot(parse_xml(text))


def read_robot(root: ET.Element, meshes: bool = False) -> Urdf:
    """Read a ``<robot>`` element.

    Args:
        root: The element.
        meshes: Accept ``<mesh>``, and leave its bodies out.

    Raises:
        ModelError: It is malformed or holds something that is not supported; a line for each finding, with
            the line of the file and the name of the element.
    """
    findings = _Findings(unread(root))
    with findings.collecting(root):
        _check_version(root)
    links, joints, bodies = (
        _links(root, findings),
        _joints(root, findings),
        _all_bodies(root, meshes, findings),
    )
    findings.check()
    return Urdf(root.get("name", ""), _root_link(links, joints), links, joints, bodies)


def check_counts(root: ET.Element) -> None:
    """Raise a ModelError if a description is so large that reading it would take minutes."""
    for tag, most in (("link", MAX_LINKS), ("joint", MAX_LINKS), ("link/collision", MAX_BODIES)):
        count = len(root.findall(tag))
        if count > most:
            what = tag.rpartition("/")[2]
            raise ModelError(f"{count} elements <{what}>; expected at most {most}: simplify the description")


def _check_version(root: ET.Element) -> None:
    version = root.get("version", VERSIONS[0])
    if version not in VERSIONS:
        raise ModelError(f"version {version!r} of URDF is not known; expected one of {', '.join(VERSIONS)}")
    turned = [
        *root.iterfind("joint/origin[@quat_xyzw]"), *root.iterfind("link/collision/origin[@quat_xyzw]"),
    ]  # fmt: skip
    if turned and version == VERSIONS[0]:
        at = getattr(turned[0], "line", None)
        where = "" if at is None else f" (line {at})"
        raise ModelError(
            f'quat_xyzw needs <robot version="1.1">{where}: other programs ignore it in this file'
        )


def _links(root: ET.Element, findings: _Findings) -> tuple[str, ...]:
    names: list[str] = []
    for element in root.findall("link"):
        with findings.collecting(element):
            names.append(_new(_name(element, "link"), "link", names))
    return tuple(names)


def _joints(root: ET.Element, findings: _Findings) -> tuple[UrdfJoint, ...]:
    links = [element.get("name", "") for element in root.findall("link")]
    names: list[str] = []
    joints = []
    for element in root.findall("joint"):
        with findings.collecting(element):
            names.append(_new(_name(element, "joint"), "joint", names))
            joints.append(_joint(element, links))
    return tuple(joints)


def _all_bodies(root: ET.Element, meshes: bool, findings: _Findings) -> tuple[UrdfBody, ...]:
    names: dict[str, bool] = {}
    bodies = []
    for link in root.findall("link"):
        for name, element in collisions(link):
            with findings.collecting(element):
                _check_body_name(link.get("name", ""), name, names)
                if not (meshes and element.find("geometry/mesh") is not None):
                    bodies.append(_body(link.get("name", ""), name, element))
    return tuple(bodies)


def _check_body_name(link: str, name: str, names: dict[str, bool]) -> None:
    """Refuse a name that is none, occurs twice, or is that of a body and that of a body in parts."""
    if not is_part_name(name):
        raise ModelError(f"link {link!r}: a body cannot be called {name!r}; expected {NAME_TEXT}")
    whole = whole_name(name)
    if name in names or names.get(whole, name != whole) != (name != whole):
        raise ModelError(f"body {whole!r} occurs twice; expected every name once")
    names[name] = names[whole] = name != whole


def _new(name: str, what: str, names: Iterable[str]) -> str:
    if name in names:
        raise ModelError(f"{what} {name!r} occurs twice; expected every name once")
    return name


def kinematics_only(text: str) -> str:
    """Return the same URDF with bare links and the joints' kinematics, as other parsers read it.

    They know no ``<capsule>``, stumble over inertias and insist on a name and on effort limits.
    """
    robot = parse_xml(text)
    plain_origins(robot)
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


def plain_origins(robot: ET.Element) -> None:
    """Replace the quaternions of joints and collisions by roll, pitch, yaw, which every program reads.

    Raises:
        ModelError: A quaternion is refused.
    """
    for element in [*robot.findall("joint"), *robot.findall("link/collision")]:
        origin = element.find("origin")
        if origin is not None and "quat_xyzw" in origin.attrib:
            _, rpy = origin_of(element, element.tag)
            del origin.attrib["quat_xyzw"]
            origin.set("rpy", number_text(rpy))


def unique_bodies(robot: ET.Element) -> None:
    """Name every collision, and put the link's name before names that several links use."""
    named = [(link, name, element) for link in robot.findall("link") for name, element in collisions(link)]
    links: dict[str, set[str]] = {}
    for link, name, _ in named:
        links.setdefault(name, set()).add(link.get("name", ""))
    for link, name, element in named:
        element.set("name", name if len(links[name]) == 1 else f"{link.get('name', '')}.{name}")


def _root_link(links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> str:
    if not links:
        raise ModelError("there is no <link>; expected at least one")
    children: list[str] = []
    for joint in joints:
        children.append(_new(joint.child, "child link", children))
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
    """Return the ``<origin>`` in an element: xyz [m] and rpy [rad].

    Raises:
        ModelError: It holds something else than numbers, or two rotations; the text begins with ``where``.
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
    x, y, z, w = numbers(origin, "quat_xyzw", 4, where)
    if abs(math.hypot(x, y, z, w) - 1.0) > _UNIT:
        raise ModelError(f"{where}: quat_xyzw of length {math.hypot(x, y, z, w):g}; expected length 1")
    return xyz, list(Placement.from_quaternion(xyz, (x, y, z, w)).rpy())


def _origin(element: ET.Element, where: str) -> Placement:
    return Placement.from_rpy(*origin_of(element, where))


# --- joints -----------------------------------------------------------------------------------------------


def _joint(element: ET.Element, links: Sequence[str]) -> UrdfJoint:
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


def _joint_link(element: ET.Element, end: str, links: Sequence[str], where: str) -> str:
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


def _limits(element: ET.Element, where: str) -> tuple[float, float, float, float, float]:
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
    return lower, upper, velocity, *_ramps(limit, where)


def _ramps(limit: ET.Element, where: str) -> tuple[float, float]:
    """Return acceleration and deceleration; the second one defaults to the first, without both it is inf."""
    ramps = []
    for attribute in ("acceleration", "deceleration"):
        if attribute in limit.attrib:
            (value,) = numbers(limit, attribute, 1, where)
            if value <= 0.0:
                raise ModelError(f"{where}: {attribute} limit {value:g}; expected more than 0")
            ramps.append(value)
        else:
            ramps.append(ramps[0] if ramps else math.inf)
    return ramps[0], ramps[1]


# --- bodies -----------------------------------------------------------------------------------------------


def collisions(link: ET.Element) -> list[tuple[str, ET.Element]]:
    """Return the collision elements of a link with the names of their bodies, unchecked."""
    elements = link.findall("collision")
    given = {element.get("name") for element in elements}
    named = []
    for number, element in enumerate(elements, start=1):
        # A link may have several nameless collisions; the first takes the link's name.
        name = link.get("name", "") if number == 1 else f"{link.get('name', '')}_{number}"
        while name in given:
            name += "_"
        named.append((element.get("name", name), element))
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


def _body(link: str, name: str, element: ET.Element) -> UrdfBody:
    where = f"link {link!r}, body {name!r}"
    return UrdfBody(name, link, _shape(element, where), _origin(element, where))


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
