"""From a configured shape to the parts of a body: one primitive, or the convex parts of a mesh."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.parts import Part

if TYPE_CHECKING:
    from armgate.cell.config import ShapeConfig


def parts_of_shape(
    shape: "ShapeConfig", folder: Path, packages: Mapping[str, Path], outline: bool = False
) -> tuple[Part, ...]:
    """Return the parts of a configured shape: itself, or those that a mesh is cut into.

    Args:
        shape: The shape.
        folder: Where relative file names count from.
        packages: Folders for ``package://``.
        outline: Read a mesh without cutting it: a stand-in takes the place of its parts.

    Raises:
        ModelError: A mesh cannot be used; the text names its file.
    """
    if shape.mesh is None:
        return (Part(shape.shape),)
    from armgate.cell.mesh.files import locate  # noqa: PLC0415  (most cells have no meshes)
    from armgate.cell.mesh.parts import how, parts_of  # noqa: PLC0415

    return parts_of(locate(shape.mesh.file, folder, packages), shape.mesh.scale, how(shape.mesh), outline)
