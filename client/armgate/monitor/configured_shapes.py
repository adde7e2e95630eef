"""Solids of configured shapes and of mesh files."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

from armgate.monitor.config_section import Section, si
from armgate.monitor.convex_solid import SIZES, Solid, primitive
from armgate.monitor.errors import DescriptionError
from armgate.monitor.files import Located
from armgate.monitor.mesh_files import read_mesh
from armgate.monitor.mesh_solids import solids_of

MESH_KEYS = ("method", "threshold", "max_parts", "max_vertices")
METHODS = ("parts", "hull")


def configured(shape: Section, packages: Mapping[str, Path]) -> list[Solid]:
    """Return the solids of a shape such as ``{box: [x, y, z]}`` or ``{mesh: {file: …}}``.

    Raises:
        DescriptionError: It is not exactly one shape that the monitor supports, or a mesh cannot be read.
    """
    shape.only(*SIZES, "mesh")
    given = {kind: value for kind, value in shape.values.items() if value is not None}
    if len(given) != 1:
        raise DescriptionError(f"{shape.where}: expected exactly one shape")
    ((kind, value),) = given.items()
    if kind == "mesh":
        return _configured_mesh(shape.section("mesh"), packages)
    sizes = value if isinstance(value, list) else [value]
    where = shape.place(kind)
    return [primitive(kind, [si(size, where, "length") for size in sizes], where)]


def _configured_mesh(mesh: Section, packages: Mapping[str, Path]) -> list[Solid]:
    mesh.only("file", "scale", *MESH_KEYS)
    file, scale = mesh.values.get("file"), mesh.values.get("scale", 1.0)
    if not isinstance(file, Located):
        raise DescriptionError(f"{mesh.where}: expected a file")
    factors = scale if isinstance(scale, list) else [scale] * 3
    factors = [si(factor, mesh.place("scale"), "length") for factor in factors]
    if len(factors) != 3:
        raise DescriptionError(f"{mesh.place('scale')}: expected one factor, or three")
    return mesh_solids(locate(file, packages), factors, method_of(mesh))


def method_of(options: Section) -> str:
    """Return the method that converts a mesh to bodies."""
    method = options.text("method", METHODS[0])
    if method not in METHODS:
        raise DescriptionError(f"{options.place('method')}: the monitor does not support {method!r}")
    return method


def mesh_solids(file: Path, scale: Sequence[float], method: str) -> list[Solid]:
    """Return the solids of a mesh file."""
    return solids_of(read_mesh(file), scale, method)


def locate(file: Located, packages: Mapping[str, Path]) -> Path:
    """Return the file that a path, ``file://…`` or ``package://NAME/…`` refers to.

    A package is looked up in the configuration, then in ROS_PACKAGE_PATH, then among the folder of the file
    that refers to it and its parent folders.

    Raises:
        DescriptionError: There is no such package, or the scheme of the URI is not supported.
    """
    uri = file.text
    scheme, mark, rest = uri.partition("://")
    if not mark or file.confined:
        return file.path
    if scheme == "file":
        return Path(unquote(urlsplit(uri).path))
    if scheme != "package":
        raise DescriptionError(f"{uri}: the monitor does not support {scheme}://")
    name, _, inside = rest.partition("/")
    if name in packages:
        return packages[name] / unquote(inside)
    listed = [Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]
    here = file.folder.absolute()
    for place in (*(entry / name for entry in listed), *listed, here, *here.parents):
        if place.name == name and place.is_dir():
            return place / unquote(inside)
    raise DescriptionError(f"{uri}: package {name!r} was not found; add its folder to meshes.packages")
