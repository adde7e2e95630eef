"""Reading and writing of collision bodies (``<collision>`` elements)."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from typing import assert_never

from armgate.cell.errors import ModelError
from armgate.cell.names import NAME_TEXT, is_part_name, part_name, whole_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    Shape,
    ShapePart,
    Sphere,
    shape_from,
)
from armgate.cell.urdf.description import UrdfBody
from armgate.cell.urdf.elements import number_text, numbers, placement_of

_SIZES = {
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "cone": ("radius", "length"),
}
_SHAPES = "sphere, capsule, cylinder, box, cone, mesh or convex"


def collisions(link: ET.Element) -> list[tuple[str, ET.Element]]:
    """Return the collision elements of a link with the names of their bodies, unchecked.

    A collision without a name gets the name of its link, with a number from the second one on.
    """
    elements = link.findall("collision")
    given = {element.get("name") for element in elements}
    named = []
    for number, element in enumerate(elements, start=1):
        name = link.get("name", "") if number == 1 else f"{link.get('name', '')}_{number}"
        while name in given:
            name += "_"
        named.append((element.get("name", name), element))
    return named


def make_names_unique(robot: ET.Element) -> None:
    """Name every collision, and prefix names that several links use with the name of the link."""
    named = [(link, name, element) for link in robot.findall("link") for name, element in collisions(link)]
    links: dict[str, set[str]] = {}
    for link, name, _ in named:
        links.setdefault(name, set()).add(link.get("name", ""))
    for link, name, element in named:
        element.set("name", name if len(links[name]) == 1 else f"{link.get('name', '')}.{name}")


def check_body_name(link: str, name: str, names: dict[str, bool]) -> None:
    """Check the name of a body, and add it to ``names``.

    Args:
        link: Name of the link.
        name: Name of the body or part.
        names: Names so far: True for parts and bodies in parts, False for bodies in one piece.

    Raises:
        ModelError: The name is invalid, occurs twice, or is the name of a body in one piece and in parts.
    """
    if not is_part_name(name):
        raise ModelError(f"link {link!r}: a body cannot be called {name!r}; expected {NAME_TEXT}")
    whole = whole_name(name)
    if name in names or names.get(whole, name != whole) != (name != whole):
        raise ModelError(f"body {whole!r} occurs twice; expected every name once")
    names[name] = names[whole] = name != whole


def read_body(link: str, name: str, element: ET.Element) -> UrdfBody:
    """Return the body of a ``<collision>`` element.

    Raises:
        ModelError: It is malformed or has an unknown shape; the text begins with link and body.
    """
    where = f"link {link!r}, body {name!r}"
    return UrdfBody(name, link, _shape(element, where), placement_of(element, where))


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
        raise ModelError(f"{where}: <mesh> refers to a file, which is not read here; load the URDF as a cell")
    raise ModelError(f"{where}: unknown shape <{shape.tag}>; expected {_SHAPES}")


def _convex(shape: ET.Element, where: str) -> Convex:
    count = len(shape.get("vertices", "").split())
    values = numbers(shape, "vertices", max(3, count - count % 3), where)
    (radius,) = numbers(shape, "radius", 1, where, "0")
    x, y, z = values[::3], values[1::3], values[2::3]
    return Convex(tuple(zip(x, y, z, strict=True)), radius)


def write_body(link: ET.Element, name: str, shape: Shape, xyz: Iterable[float], rpy: Iterable[float]) -> None:
    """Add a collision body to a link, at an origin of xyz [m] and rpy [rad] in the link's frame."""
    collision = ET.SubElement(link, "collision", name=name)
    ET.SubElement(collision, "origin", xyz=number_text(xyz), rpy=number_text(rpy))
    geometry = ET.SubElement(collision, "geometry")
    match shape:
        case Box():
            ET.SubElement(geometry, "box", size=number_text(shape.size))
        case Convex():
            corners = number_text(value for vertex in shape.vertices for value in vertex)
            ET.SubElement(geometry, "convex", radius=repr(shape.radius), vertices=corners)
        case Sphere() | Capsule() | Cylinder() | Cone():
            sizes = zip(_SIZES[shape.kind], map(repr, shape.size), strict=True)
            ET.SubElement(geometry, shape.kind, dict(sizes))
        case _:
            assert_never(shape)


def write_parts(
    link: ET.Element, name: str, parts: Sequence[ShapePart], xyz: Sequence[float], rpy: Sequence[float]
) -> None:
    """Add the parts of a body to a link, as ``name`` or as ``name/1``, ``name/2``…."""
    body = Placement.from_rpy(xyz, rpy)
    for number, part in enumerate(parts, start=1):
        position = body.apply(part.position).tolist() if any(part.position) else xyz
        write_body(link, part_name(name, number, len(parts)), part.shape, position, rpy)
