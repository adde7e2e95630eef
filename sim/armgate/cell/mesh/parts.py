"""From a mesh file to convex bodies."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.extras import install
from armgate.cell.mesh.decompose import Cut, check_closed, cut
from armgate.cell.mesh.files import MAX_BYTES, Mesh, read_mesh
from armgate.cell.parts import Part
from armgate.cell.plain_file import read_file
from armgate.cell.shapes import Convex, Sphere

if TYPE_CHECKING:
    from armgate.cell.config import MeshOptions

Scale = tuple[float, float, float]


def how(options: "MeshOptions") -> Cut:
    """How to cut, from the configuration."""
    return Cut(options.method, options.threshold, options.max_parts, options.max_vertices)


_STAND_IN = (Part(Sphere(1e-3)),)


def parts_of(file: Path, scale: Scale, how: Cut, outline: bool = False) -> tuple[Part, ...]:
    """Return the convex bodies that together contain the mesh in a file with all that it encloses.

    Args:
        file: STL, OBJ, PLY or OFF.
        scale: What its coordinates are multiplied with to be in m.
        how: How to cut.
        outline: Read the file, but do not cut the mesh: return a small sphere instead.

    Raises:
        ModelError: The file cannot be used; the text names it.
    """
    try:
        data, suffix = read_file(file, MAX_BYTES), file.suffix.lower().removeprefix(".")
        if outline:
            check_closed(_mesh(data, suffix, scale), how)
            return _STAND_IN
        return _parts(data, suffix, scale, how)
    except ModelError as error:
        raise ModelError(f"mesh {file}: {error}") from error
    except ImportError as error:
        raise ModelError(f"mesh {file}: {error}; {install('cell')}") from error


@lru_cache(maxsize=64)
def _mesh(data: bytes, suffix: str, scale: Scale) -> Mesh:
    return read_mesh(data, suffix, scale)


@lru_cache(maxsize=64)  # robots of one kind share their meshes
def _parts(data: bytes, suffix: str, scale: Scale, how: Cut) -> tuple[Part, ...]:
    bodies = cut(_mesh(data, suffix, scale), how)
    return tuple(Part(*Convex.centred(body.vertices, body.radius)) for body in bodies)
