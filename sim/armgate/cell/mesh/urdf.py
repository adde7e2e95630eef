"""Replaces the meshes in a URDF by the convex bodies that contain them, so that it needs no other files."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.mesh.decompose import Cut
from armgate.cell.mesh.files import locate
from armgate.cell.mesh.parts import how, parts_of
from armgate.cell.parts import Part, add_parts
from armgate.cell.urdf import collisions, numbers, origin_of
from armgate.cell.urdf_xml import place

if TYPE_CHECKING:
    from armgate.cell.config import MeshesConfig


def inline_meshes(
    robot: ET.Element,
    folder: Path,
    options: "MeshesConfig",
    packages: Mapping[str, Path],
    outline: bool = False,
) -> None:
    """Replace every ``<collision>`` with a ``<mesh>`` by some with ``<convex>``: ``arm/1``, ``arm/2``….

    Args:
        robot: The ``<robot>`` element; changed in place.
        folder: Where the URDF is: relative file names count from there.
        options: How to cut, and which bodies differently.
        packages: Folders for ``package://``.
        outline: Read the meshes without cutting them: each becomes one small body.

    Raises:
        ModelError: Meshes cannot be used, or an option names no body; a line for each, with link, body and
            file.
    """
    known: set[str] = set()
    findings: list[str] = []
    for link in robot.findall("link"):
        named = collisions(link)
        known.update([link.get("name", ""), *(name for name, _ in named)])
        if any(element.find("geometry/mesh") is not None for _, element in named):
            for name, element in named:
                element.set("name", name)  # said outright: a number would change with the parts before it
                own = options.bodies.get(name) or options.bodies.get(link.get("name", "")) or options
                at = place(element)
                try:
                    _inline(link, element, how(own), (folder, packages), outline)
                except ModelError as error:
                    findings.append(f"{at}{error}")
    findings += [
        f"meshes.bodies names {name!r}, but the URDF has no such link or body"
        for name in options.bodies
        if name not in known
    ]
    if findings:
        raise ModelError("\n".join(findings))


def _inline(
    link: ET.Element,
    element: ET.Element,
    way: Cut,
    where_to_look: tuple[Path, Mapping[str, Path]],
    outline: bool,
) -> None:
    mesh, name = element.find("geometry/mesh"), element.get("name", "")
    if mesh is None:
        return
    where = f"link {link.get('name')!r}, body {name!r}"
    xyz, rpy = origin_of(element, where)
    x, y, z = numbers(mesh, "scale", 3, where, "1 1 1")
    uri = mesh.get("filename")
    if not uri:
        raise ModelError(f"{where}: <mesh> lacks the attribute 'filename'")
    try:
        parts: tuple[Part, ...] = parts_of(locate(uri, *where_to_look), (x, y, z), way, outline)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error
    link.remove(element)
    add_parts(link, name, parts, xyz, rpy)
