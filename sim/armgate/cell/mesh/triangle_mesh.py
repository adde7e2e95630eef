"""Triangle meshes, read strictly: a mesh contains every face of its file, or the file is refused."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.mesh.formats.faces import Faces, triangulate
from armgate.cell.mesh.formats.obj import read_obj
from armgate.cell.mesh.formats.off import read_off
from armgate.cell.mesh.formats.ply import read_ply
from armgate.cell.mesh.formats.stl import read_stl
from armgate.cell.shapes import MAX_EXTENT, is_solid

Array = NDArray[np.float64]

READERS: dict[str, Callable[[bytes], Faces]] = {
    "stl": read_stl,
    "obj": read_obj,
    "ply": read_ply,
    "off": read_off,
}
MAX_BYTES = 64 * 1024 * 1024
MAX_TRIANGLES = 200_000


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Surface of triangles.

    Attributes:
        vertices: Vertices, (v, 3), m.
        faces: Indices of vertices, (f, 3). Faces without an area are kept: their edges may belong to no other
            face.
        open_edges: Number of edges that do not belong to an even number of triangles; 0 if the surface
            encloses a volume.
        slack: Largest distance of a point of the file's faces to the triangles, m, see ``formats.faces``.
    """

    vertices: Array
    faces: NDArray[np.int64]
    open_edges: int
    slack: float

    @property
    def triangles(self) -> Array:
        """Corners of all triangles, (f, 3, 3), m."""
        return np.asarray(self.vertices[self.faces])


def read_mesh(data: bytes, suffix: str, scale: tuple[float, float, float]) -> TriangleMesh:
    """Return the surface in the bytes of a file.

    Args:
        data: Content of the file.
        suffix: Format of the file, a key of ``READERS``.
        scale: Factors that convert its coordinates to m.

    Raises:
        ModelError: The format is unknown, the file is damaged, has no faces, or is a flat sheet; the text
            gives the remedy.
    """
    _check_input(data, suffix, scale)
    faces = READERS[suffix](data)
    if len(faces.sizes) == 0:
        raise ModelError("no triangles in it; expected a surface")
    count = int((faces.sizes - 2).sum())
    if count > MAX_TRIANGLES:
        raise ModelError(f"{count} triangles; expected at most {MAX_TRIANGLES}: simplify the mesh")
    vertices = faces.vertices * np.array(scale) + 0.0  # + 0: makes -0 and 0 the same vertex
    if np.abs(vertices).max() > MAX_EXTENT:
        raise ModelError(
            f"a coordinate of {np.abs(vertices).max():g} m; expected at most {MAX_EXTENT:g} m: give another "
            f"scale"
        )
    triangles, slack = triangulate(faces, vertices)
    return _merged(vertices, triangles[:, ::-1] if np.prod(scale) < 0.0 else triangles, slack)


def _check_input(data: bytes, suffix: str, scale: tuple[float, float, float]) -> None:
    if suffix not in READERS:
        known = ", ".join(READERS)
        raise ModelError(f"files of the kind {suffix!r} are not supported; convert it to one of {known}")
    if len(data) > MAX_BYTES:
        raise ModelError(f"{len(data)} bytes; expected at most {MAX_BYTES}: simplify the mesh")
    if not all(math.isfinite(factor) and factor != 0.0 for factor in scale):
        raise ModelError(f"the scale {scale} has a factor that is 0 or not finite")


def _merged(vertices: Array, faces: NDArray[np.int64], slack: float) -> TriangleMesh:
    """Merge equal vertices (STL has three for each triangle) and drop those without a face."""
    used, inverse = np.unique(vertices[faces.reshape(-1)], axis=0, return_inverse=True)
    if not is_solid(used):
        raise ModelError("it is flat, without an inside; expected a solid body, or another scale")
    merged = inverse.reshape(-1, 3)
    return TriangleMesh(used, merged, _open_edges(merged), slack)


def _open_edges(faces: NDArray[np.int64]) -> int:
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.count_nonzero(counts % 2))
