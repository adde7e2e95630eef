"""Packing of a configuration and its files into one folder, from which the same cell is built anywhere."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from armgate.cell.config.cell import CellConfig, load_config
from armgate.cell.errors import ModelError
from armgate.cell.mesh.locate import locate
from armgate.cell.urdf.xml_tree import parse_xml

CONFIG = "config.yaml"
"""Name of the configuration's own file."""
_MAX_NAME_BYTES = 200
_COLLISION_MESHES = "link/collision/geometry/mesh"
"""Path of the meshes that are read when a cell is built; visual meshes are not."""


def pack(config: CellConfig) -> dict[str, bytes]:
    """Return the files of a folder from which the same cell is built: ``config.yaml``, URDFs and meshes.

    Raises:
        OSError: A file cannot be read.
        ModelError: A mesh file is missing.
    """
    return _Packer(config).packed()


def unpack(files: Mapping[str, bytes], folder: Path) -> Path:
    """Write packed files into an empty folder.

    Returns:
        The path of the configuration.

    Raises:
        ModelError: A name is not a plain file name, or the configuration is missing.
        OSError: A file cannot be written.
    """
    for name, data in files.items():
        if not _is_plain(name):
            raise ModelError(f"a packed file is called {name[:60]!r}; expected a plain name")
        (folder / name).write_bytes(data)
    if CONFIG not in files:
        raise ModelError(f"the packed files do not include {CONFIG}")
    return folder / CONFIG


def load_packed(files: Mapping[str, bytes], folder: Path, overlay: str | None = None) -> CellConfig:
    """Read a packed configuration, which is untrusted and may therefore refer to packed files only.

    Args:
        files: Files as ``pack`` returned them.
        folder: Empty folder, in which they must stay until the cell is built.
        overlay: YAML that overlays the configuration.

    Raises:
        ConfigError: The configuration or the overlay is not what was expected.
        ModelError: A name is not a plain file name, or the configuration refers to a file that is not packed.
    """
    own = unpack(files, folder)
    config = load_config([own])
    _check_references(config, files)
    if overlay is None:
        return config
    path = folder / ".overlay.yaml"
    path.write_text(overlay, encoding="utf-8")
    return load_config([own, path])


def _is_plain(name: str) -> bool:
    return (
        name.isprintable()
        and not name.startswith(".")
        and "/" not in name
        and 0 < len(name.encode(errors="replace")) <= _MAX_NAME_BYTES
    )


def _check_references(config: CellConfig, files: Mapping[str, bytes]) -> None:
    for name in _references(config, files):
        if name not in files or not _is_plain(name):
            raise ModelError(f"the packed configuration refers to {name[:60]!r}, which is not packed with it")


def _references(config: CellConfig, files: Mapping[str, bytes]) -> Iterator[str]:
    """Yield the names of all files that are read when the cell is built."""
    shapes = [surrounding.shape for surrounding in config.surroundings.values()]
    for robot in config.robots.values():
        yield robot.urdf
        yield from robot.meshes.packages.values()
        shapes += [body.shape for body in robot.bodies.values()]
        if robot.urdf in files:
            yield from _urdf_meshes(files[robot.urdf], robot.urdf)
    for shape in shapes:
        if shape.mesh:
            yield shape.mesh.file


def _urdf_meshes(urdf: bytes, name: str) -> Iterator[str]:
    try:
        root = parse_xml(urdf.decode())
    except UnicodeDecodeError as error:
        raise ModelError(f"{name}: not UTF-8; expected a packed URDF") from error
    for mesh in root.findall(_COLLISION_MESHES):
        yield mesh.get("filename", "")


class _Packer:
    def __init__(self, config: CellConfig) -> None:
        self._config = config
        self._files: dict[str, bytes] = {}

    def packed(self) -> dict[str, bytes]:
        tree: dict[str, Any] = self._config.model_dump(mode="json")
        for name, own in tree["robots"].items():
            packages = self._packages(name)
            own["urdf"] = self._urdf(name, packages)
            own["meshes"]["packages"] = {}
            for body, part in own["bodies"].items():
                self._shape(("robots", name, "bodies", body), part["shape"], packages)
        for name, own in tree["surroundings"].items():
            self._shape(("surroundings", name), own["shape"], {})
        text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
        return {CONFIG: text.encode(), **self._files}

    def _packages(self, robot: str) -> dict[str, Path]:
        given = self._config.robots[robot].meshes.packages
        key = ("robots", robot, "meshes", "packages")
        return {name: self._config.file((*key, name), folder) for name, folder in given.items()}

    def _urdf(self, robot: str, packages: Mapping[str, Path]) -> str:
        path = self._config.urdf_path(robot)
        data = path.read_bytes()
        root = parse_xml(data.decode())
        meshes = root.findall(_COLLISION_MESHES)
        for mesh in meshes:
            mesh.set("filename", self._mesh(mesh.get("filename", ""), path.parent, packages))
        return self._add(f"{robot}.urdf", ET.tostring(root) if meshes else data)

    def _shape(self, key: tuple[str, ...], shape: dict[str, Any], packages: Mapping[str, Path]) -> None:
        if shape.get("mesh"):
            folder = self._config.file((*key, "shape", "mesh", "file"), "")
            shape["mesh"]["file"] = self._mesh(shape["mesh"]["file"], folder, packages)

    def _mesh(self, uri: str, folder: Path, packages: Mapping[str, Path]) -> str:

        path = locate(uri, folder, packages)
        return self._add(path.name, path.read_bytes())

    def _add(self, name: str, data: bytes) -> str:
        """Add a file and return its name, which gets a number if it is taken by other content."""
        stem, number = name, 1
        while self._files.get(name, data) != data or name == CONFIG:
            number += 1
            name = f"{number}-{stem}"
        self._files[name] = data
        return name
