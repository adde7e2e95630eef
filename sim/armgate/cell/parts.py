"""Of what a body consists: shapes, each in its place."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from armgate.cell.names import part_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape
from armgate.cell.urdf import write_body


@dataclass(frozen=True)
class Part:
    """A shape, and where its frame is in the body's frame (equally directed), m."""

    shape: Shape
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


def add_parts(
    link: ET.Element, name: str, parts: Sequence[Part], xyz: Sequence[float], rpy: Sequence[float]
) -> None:
    """Adds the parts of a body to a link of a URDF, as ``name``, or ``name/1``, ``name/2``…."""
    place = Placement.from_rpy(xyz, rpy)
    for number, part in enumerate(parts, start=1):
        at = place.apply(part.at).tolist() if any(part.at) else xyz
        write_body(link, part_name(name, number, len(parts)), part.shape, at, rpy)
