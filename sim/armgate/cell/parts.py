"""Of what a body consists: one primitive, or the convex parts of a mesh."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.names import part_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape
from armgate.cell.urdf import write_body

if TYPE_CHECKING:
    from armgate.cell.config import ShapeConfig


@dataclass(frozen=True)
class Part:
    """A shape, and where its frame is in the body's frame (equally directed), m."""

    shape: Shape
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


def parts_of_shape(shape: "ShapeConfig", folder: Path, packages: Mapping[str, Path]) -> tuple[Part, ...]:
    """The parts of a configured shape: itself, or those that a mesh is cut into.

    Args:
        shape: The shape.
        folder: Where relative file names count from.
        packages: Folders for ``package://``.

    Raises:
        ModelError: A mesh cannot be used; the text names its file.
    """
    if shape.mesh is None:
        return (Part(shape.shape),)
    from armgate.cell.mesh.files import locate  # noqa: PLC0415  (most cells have no meshes)
    from armgate.cell.mesh.parts import how, parts_of  # noqa: PLC0415

    return parts_of(locate(shape.mesh.file, folder, packages), shape.mesh.scale, how(shape.mesh))


def add_parts(
    link: ET.Element, name: str, parts: Sequence[Part], xyz: Sequence[float], rpy: Sequence[float]
) -> None:
    """Adds the parts of a body to a link of a URDF, as ``name``, or ``name/1``, ``name/2``…."""
    place = Placement.from_rpy(xyz, rpy)
    for number, part in enumerate(parts, start=1):
        at = place.apply(part.at).tolist() if any(part.at) else xyz
        write_body(link, part_name(name, number, len(parts)), part.shape, at, rpy)
