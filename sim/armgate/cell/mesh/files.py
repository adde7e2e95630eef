"""Search for mesh files, and strict reading: a mesh has every face of its file, or the file is refused."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.mesh.obj import read_obj
from armgate.cell.mesh.off import read_off
from armgate.cell.mesh.ply import read_ply
from armgate.cell.mesh.soup import Soup, triangulated
from armgate.cell.mesh.stl import read_stl
from armgate.cell.plain_file import is_file
from armgate.cell.shapes import is_solid
from armgate.cell.units import MAX_EXTENT

Array = NDArray[np.float64]

READERS: dict[str, Callable[[bytes], Soup]] = {
    "stl": read_stl,
    "obj": read_obj,
    "ply": read_ply,
    "off": read_off,
}
MAX_BYTES = 64 * 1024 * 1024
MAX_TRIANGLES = 200_000


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles.

    Attributes:
        vertices: (v, 3), m.
        faces: Indices of vertices, (f, 3); a face without an area is kept, for its edge may stand alone.
        open_edges: Number of edges that do not belong to an even number of triangles; 0: the surface encloses
            a volume.
        slack: Largest distance of a point of the file's faces to the triangles, m, see ``soup``.
    """

    vertices: Array
    faces: NDArray[np.int64]
    open_edges: int
    slack: float

    @property
    def triangles(self) -> Array:
        """The corners of all triangles, (f, 3, 3), m."""
        return np.asarray(self.vertices[self.faces])


def locate(uri: str, folder: Path, packages: Mapping[str, Path]) -> Path:
    """The file that a URI or path names.

    ``package://NAME/rest`` is looked for in ``packages``, then in the folders of ROS_PACKAGE_PATH, then among
    the folders that hold ``folder``: a description often lies in the package that it names.

    Args:
        uri: A path (relative ones count from ``folder``), ``file://…`` or ``package://…``.
        folder: Where the description is that names it.
        packages: Folders of packages by name.

    Raises:
        ModelError: There is no such package or file, or the URI is of another kind.
    """
    if "$(" in uri or "${" in uri:
        raise ModelError(
            f"{uri}: left over from xacro; expand the file first: xacro ROBOT.urdf.xacro > ROBOT.urdf"
        )
    scheme, colon, rest = uri.partition("://")
    if not colon:
        path = folder / uri
    elif scheme == "file":
        path = Path(unquote(_path_of(uri)))
    elif scheme == "package":
        name, _, inside = rest.partition("/")
        path = _package(name, folder, packages) / unquote(inside)
    else:
        raise ModelError(f"{uri}: {scheme}:// is not supported; expected a path, file:// or package://")
    if not is_file(path):
        raise ModelError(f"{_short(uri)}: there is no file {_short(str(path))}; check the name")
    return path


def _path_of(uri: str) -> str:
    try:
        return urlsplit(uri).path
    except ValueError as error:
        raise ModelError(f"{uri}: not a URI ({error}); expected a path, file:// or package://") from error


def _short(text: str) -> str:
    return text if len(text) <= 200 else text[:197] + "..."


def _package(name: str, folder: Path, packages: Mapping[str, Path]) -> Path:
    if name in packages:
        return packages[name]
    roots = [Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]
    around = folder.absolute().parents
    places = [*(root / name for root in roots), *roots, folder.absolute(), *around]
    for place in places:
        if place.name == name and place.is_dir():
            return place
    raise ModelError(
        f"package {name!r} is not known; name its folder in meshes.packages or in ROS_PACKAGE_PATH"
    )


def read_mesh(data: bytes, suffix: str, scale: tuple[float, float, float]) -> Mesh:
    """Return the surface in the bytes of a file.

    Args:
        data: The file.
        suffix: Its kind, a key of ``READERS``.
        scale: Factors that make metres of its coordinates.

    Raises:
        ModelError: The kind is unknown, the file is damaged, has no faces, or encloses nothing but a flat
            sheet; the text says what to do.
    """
    _check_door(data, suffix, scale)
    soup = READERS[suffix](data)
    if len(soup.sizes) == 0:
        raise ModelError("no triangles in it; expected a surface")
    count = int((soup.sizes - 2).sum())
    if count > MAX_TRIANGLES:
        raise ModelError(f"{count} triangles; expected at most {MAX_TRIANGLES}: simplify the mesh")
    vertices = soup.vertices * np.array(scale) + 0.0  # + 0: -0 and 0 are one number
    if np.abs(vertices).max() > MAX_EXTENT:
        raise ModelError(
            f"a coordinate of {np.abs(vertices).max():g} m; expected at most {MAX_EXTENT:g} m: give another "
            f"scale"
        )
    faces, slack = triangulated(soup, vertices)
    return _cleaned(vertices, faces[:, ::-1] if np.prod(scale) < 0.0 else faces, slack)


def _check_door(data: bytes, suffix: str, scale: tuple[float, float, float]) -> None:
    if suffix not in READERS:
        known = ", ".join(READERS)
        raise ModelError(f"files of the kind {suffix!r} are not supported; convert it to one of {known}")
    if len(data) > MAX_BYTES:
        raise ModelError(f"{len(data)} bytes; expected at most {MAX_BYTES}: simplify the mesh")
    if not all(math.isfinite(factor) and factor != 0.0 for factor in scale):
        raise ModelError(f"the scale {scale} has a factor that is 0 or not finite")


def _cleaned(vertices: Array, faces: NDArray[np.int64], slack: float) -> Mesh:
    """Merge equal vertices (STL has three a triangle) and leave out those without a face."""
    used, inverse = np.unique(vertices[faces.reshape(-1)], axis=0, return_inverse=True)
    if not is_solid(used):
        raise ModelError("it is flat, without an inside; expected a solid body, or another scale")
    merged = inverse.reshape(-1, 3)
    return Mesh(used, merged, _open_edges(merged), slack)


def _open_edges(faces: NDArray[np.int64]) -> int:
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.count_nonzero(counts % 2))
