"""Replacement of the meshes in a URDF by the convex bodies that contain them."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.mesh.convex_parts import convex_parts, decomposition_options
from armgate.cell.mesh.locate import locate
from armgate.cell.urdf.bodies import collisions, write_parts
from armgate.cell.urdf.elements import numbers, origin_of
from armgate.cell.urdf.xml_tree import line_prefix

if TYPE_CHECKING:
    from armgate.cell.config import MeshesConfig, MeshOptions


@dataclass(frozen=True)
class _Source:
    """Place of the mesh files.

    Attributes:
        folder: Folder of the URDF, from which relative file names start.
        packages: Folders for ``package://``.
        outline: Check the meshes without cutting them.
    """

    folder: Path
    packages: Mapping[str, Path]
    outline: bool


def inline_meshes(
    robot: ET.Element,
    folder: Path,
    options: "MeshesConfig",
    packages: Mapping[str, Path],
    outline: bool = False,
) -> None:
    """Replace every ``<collision>`` with a ``<mesh>`` by elements with ``<convex>``: ``arm/1``, ``arm/2``….

    Args:
        robot: The ``<robot>`` element; changed in place.
        folder: Folder of the URDF, from which relative file names start.
        options: Options of the decomposition, for all and for single bodies.
        packages: Folders for ``package://``.
        outline: If true, check the meshes without cutting them: each becomes one small body.

    Raises:
        ModelError: Meshes cannot be used, or an option is for a body that does not exist; a line for each,
            with link, body and file.
    """
    known: set[str] = set()
    errors: list[str] = []
    source = _Source(folder, packages, outline)
    for link in robot.findall("link"):
        named = collisions(link)
        known.update([link.get("name", ""), *(name for name, _ in named)])
        if any(element.find("geometry/mesh") is not None for _, element in named):
            errors += _inline_link(link, named, options, source)
    errors += [
        f"meshes.bodies names {name!r}, but the URDF has no such link or body"
        for name in options.bodies
        if name not in known
    ]
    if errors:
        raise ModelError("\n".join(errors))


def _inline_link(
    link: ET.Element, named: list[tuple[str, ET.Element]], options: "MeshesConfig", source: _Source
) -> list[str]:
    """Replace the meshes of one link; return the errors."""
    errors = []
    for name, element in named:
        element.set("name", name)  # a default name has a number, which the parts before it would change
        own = options.bodies.get(name) or options.bodies.get(link.get("name", "")) or options
        prefix = line_prefix(element)
        try:
            _inline(link, element, own, source)
        except ModelError as error:
            errors.append(f"{prefix}{error}")
    return errors


def _inline(link: ET.Element, element: ET.Element, options: "MeshOptions", source: _Source) -> None:
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
        file = locate(uri, source.folder, source.packages)
        parts = convex_parts(file, (x, y, z), decomposition_options(options), source.outline)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error
    link.remove(element)
    write_parts(link, name, parts, xyz, rpy)
