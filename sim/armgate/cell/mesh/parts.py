"""From a mesh file to convex bodies."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.errors import ModelError
from armgate.cell.mesh.decompose import Cut, cut
from armgate.cell.mesh.files import read_mesh
from armgate.cell.parts import Part
from armgate.cell.shapes import Convex

if TYPE_CHECKING:
    from armgate.cell.config import MeshOptions

Scale = tuple[float, float, float]


def how(options: "MeshOptions") -> Cut:
    """How to cut, from the configuration."""
    return Cut(options.method, options.threshold, options.max_parts, options.max_vertices)


def parts_of(file: Path, scale: Scale, how: Cut) -> tuple[Part, ...]:
    """The convex bodies that together contain the mesh in a file with all that it encloses.

    Args:
        file: STL, OBJ, PLY or OFF.
        scale: What its coordinates are multiplied with to be in m.
        how: How to cut.

    Raises:
        ModelError: The file cannot be used; the text names it.
    """
    try:
        return _parts(file.read_bytes(), file.suffix.lower().removeprefix("."), scale, how)
    except OSError as error:
        raise ModelError(f"mesh {file} cannot be read: {error.strerror}") from error
    except ModelError as error:
        raise ModelError(f"mesh {file}: {error}") from error
    except ImportError as error:
        raise ModelError(f"mesh {file}: {error}; meshes need pip install 'armgate[cell]'") from error


@lru_cache(maxsize=64)  # robots of one kind share their meshes
def _parts(data: bytes, suffix: str, scale: Scale, how: Cut) -> tuple[Part, ...]:
    bodies = cut(read_mesh(data, suffix, scale), how)
    return tuple(Part(*Convex.centred(body.vertices, body.radius)) for body in bodies)
