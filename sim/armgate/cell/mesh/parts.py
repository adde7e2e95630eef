"""From a mesh file to convex bodies: read, cut or remembered, proven."""

from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh import cache
from armgate.cell.mesh.cover import shortfall
from armgate.cell.mesh.decompose import GROW, Cut, bodies, cut
from armgate.cell.mesh.files import Mesh, read_mesh
from armgate.cell.mesh.hull import Hull, hull_of
from armgate.cell.parts import Part
from armgate.cell.shapes import Convex

if TYPE_CHECKING:
    from armgate.cell.config import MeshOptions

if TYPE_CHECKING:
    from armgate.cell.config import MeshOptions

Scale = tuple[float, float, float]


def how(options: "MeshOptions") -> Cut:
    """How to cut, from the configuration."""
    return Cut(options.method, options.threshold, options.max_parts, options.max_vertices)


def parts_of(file: Path, scale: Scale, how: Cut) -> tuple[Part, ...]:
    """The convex bodies that together contain the surface in a file.

    Args:
        file: STL, OBJ, PLY or OFF.
        scale: What its coordinates are multiplied with to be in m.
        how: How to cut.

    Raises:
        ModelError: The file cannot be used; the text names it.
    """
    try:
        data = file.read_bytes()
        mesh = read_mesh(data, file.suffix.lower().removeprefix("."), scale)
        hulls, missing = _proven(mesh, data, scale, how)
        return tuple(_part(body) for body in bodies(hulls, missing, how.max_vertices))
    except OSError as error:
        raise ModelError(f"mesh {file} cannot be read: {error.strerror}") from error
    except ModelError as error:
        raise ModelError(f"mesh {file}: {error}") from error
    except ImportError as error:
        raise ModelError(f"mesh {file}: {error}; meshes need pip install 'armgate[cell]'") from error


def _part(body: Convex) -> Part:
    return Part(*Convex.centred(body.vertices, body.radius))


def _proven(mesh: Mesh, data: bytes, scale: Scale, how: Cut) -> tuple[tuple[Hull, ...], float]:
    """The parts, and by how much they fall short of the surface [m]: proven here, wherever they come from."""
    name = cache.key(data, scale, asdict(how), version("coacd"))
    if how.method != "hull":
        known = _remembered(name)
        missing = shortfall(mesh.triangles, known) if known else np.inf
        if missing <= GROW:
            return known, missing
    hulls = cut(mesh, how)
    if how.method != "hull":
        cache.write(name, [hull.vertices for hull in hulls])
    return hulls, shortfall(mesh.triangles, hulls)


def _remembered(name: str) -> tuple[Hull, ...]:
    try:
        return tuple(hull_of(points) for points in cache.read(name) or ())
    except ModelError:
        return ()
