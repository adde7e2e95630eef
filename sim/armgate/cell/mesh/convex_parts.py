"""Convex parts of a mesh file: reading and decomposition, with a cache for robots that share meshes."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError, install_hint
from armgate.cell.mesh.decomposition.decompose import DecompositionOptions, check_closed, decompose
from armgate.cell.mesh.triangle_mesh import MAX_BYTES, TriangleMesh, read_mesh
from armgate.cell.regular_file import read_file
from armgate.cell.shapes import Convex, ShapePart, Sphere

if TYPE_CHECKING:
    from armgate.cell.config import MeshOptions

Scale = tuple[float, float, float]

_STAND_IN = (ShapePart(Sphere(1e-3)),)


def decomposition_options(options: "MeshOptions") -> DecompositionOptions:
    """Return the options of the decomposition from the configuration."""
    return DecompositionOptions(options.method, options.threshold, options.max_parts, options.max_vertices)


def convex_parts(
    file: Path, scale: Scale, options: DecompositionOptions, outline: bool = False
) -> tuple[ShapePart, ...]:
    """Return convex parts that together contain the mesh in a file and everything that it encloses.

    Args:
        file: STL, OBJ, PLY or OFF file.
        scale: Factors that convert its coordinates to m.
        options: Options of the decomposition.
        outline: If true, check the file without cutting the mesh, and return a small sphere.

    Raises:
        ModelError: The file cannot be used; the text names it.
    """
    try:
        data, suffix = read_file(file, MAX_BYTES), file.suffix.lower().removeprefix(".")
        if outline:
            check_closed(_mesh(data, suffix, scale), options)
            return _STAND_IN
        return _parts(data, suffix, scale, options)
    except ModelError as error:
        raise ModelError(f"mesh {file}: {error}") from error
    except ImportError as error:
        raise ModelError(f"mesh {file}: {error}; {install_hint('cell')}") from error


@lru_cache(maxsize=64)
def _mesh(data: bytes, suffix: str, scale: Scale) -> TriangleMesh:
    return read_mesh(data, suffix, scale)


@lru_cache(maxsize=64)
def _parts(data: bytes, suffix: str, scale: Scale, options: DecompositionOptions) -> tuple[ShapePart, ...]:
    bodies = decompose(_mesh(data, suffix, scale), options)
    return tuple(ShapePart(*Convex.centred(body.vertices, body.radius)) for body in bodies)
