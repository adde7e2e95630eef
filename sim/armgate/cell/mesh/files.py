"""Where mesh files are, and what is in them: read strictly, anything doubtful is refused with its reason."""

import io
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from armgate.cell.errors import ModelError
from armgate.cell.shapes import is_solid

Array = NDArray[np.float64]

SUFFIXES = ("stl", "obj", "ply", "off")
MAX_BYTES = 64 * 1024 * 1024
MAX_TRIANGLES = 200_000


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles.

    Attributes:
        vertices: (v, 3), m.
        faces: Indices of vertices, (f, 3); none has the area zero.
        open_edges: How many edges do not belong to an even number of triangles; 0: the surface encloses
            a volume.
    """

    vertices: Array
    faces: NDArray[np.int64]
    open_edges: int

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
    scheme, colon, rest = uri.partition("://")
    if not colon:
        path = folder / uri
    elif scheme == "file":
        path = Path(unquote(urlsplit(uri).path))
    elif scheme == "package":
        name, _, inside = rest.partition("/")
        path = _package(name, folder, packages) / unquote(inside)
    else:
        raise ModelError(f"{uri}: {scheme}:// is not supported; expected a path, file:// or package://")
    if not path.is_file():
        raise ModelError(f"{uri}: there is no file {path}")
    return path


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
    """The surface in the bytes of a file.

    Args:
        data: The file.
        suffix: Its kind, one of ``SUFFIXES``.
        scale: What coordinates are multiplied with to be in m.

    Raises:
        ModelError: Another kind of file, one that cannot be read, has no triangles, values that are no finite
            numbers, or nothing but a flat sheet.
    """
    import trimesh  # noqa: PLC0415  (most cells have no meshes)

    _check_door(data, suffix, scale)
    try:
        read = trimesh.load_mesh(io.BytesIO(data), file_type=suffix, process=False, skip_materials=True)
        vertices, faces = np.array(read.vertices, dtype=np.float64), np.array(read.faces)
    except Exception as error:  # whatever a parser may raise about a damaged file
        raise ModelError(f"not readable as {suffix.upper()}: {error or type(error).__name__}") from error
    if len(faces) == 0:
        raise ModelError("no triangles in it; expected a surface")
    if len(faces) > MAX_TRIANGLES:
        raise ModelError(f"{len(faces)} triangles; expected at most {MAX_TRIANGLES}: simplify the mesh")
    if not np.all(np.isfinite(vertices)):
        raise ModelError("a coordinate is no finite number")
    mirrored = np.prod(scale) < 0.0
    return _cleaned(vertices * np.array(scale), faces[:, ::-1] if mirrored else faces)


def _check_door(data: bytes, suffix: str, scale: tuple[float, float, float]) -> None:
    if suffix not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise ModelError(f"files of the kind {suffix!r} are not supported; convert it to one of {known}")
    if len(data) > MAX_BYTES:
        raise ModelError(f"{len(data)} bytes; expected at most {MAX_BYTES}: simplify the mesh")
    if not all(math.isfinite(factor) and factor != 0.0 for factor in scale):
        raise ModelError(f"the scale {scale} has a factor that is 0 or not finite")


def _cleaned(vertices: Array, faces: NDArray[np.int64]) -> Mesh:
    """Equal vertices made one (STL has three a triangle), and triangles left out that this makes lines of."""
    unique, inverse = np.unique(vertices, axis=0, return_inverse=True)
    merged = inverse.reshape(-1)[faces]
    a, b, c = merged.T
    merged = merged[(a != b) & (b != c) & (c != a)]
    used = np.unique(merged)
    if len(used) == 0 or not is_solid(unique[used]):
        raise ModelError("it is flat, without an inside; expected a solid body, or another scale")
    compact = np.zeros(len(unique), dtype=np.int64)
    compact[used] = np.arange(len(used))
    merged = compact[merged]
    return Mesh(unique[used], merged, _open_edges(merged))


def _open_edges(faces: NDArray[np.int64]) -> int:
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.count_nonzero(counts % 2))
