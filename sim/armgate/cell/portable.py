"""A configuration with all the files that it needs, as one folder: the same cell on any machine."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from armgate.cell.config import CellConfig, load_config
from armgate.cell.errors import ModelError
from armgate.cell.urdf import parse_xml

CONFIG = "config.yaml"
"""The configuration's own file."""


def pack(config: CellConfig) -> dict[str, bytes]:
    """The files of a folder from which the same cell is built: ``config.yaml``, URDFs and meshes.

    Raises:
        OSError: A file cannot be read.
        ModelError: A mesh is not where it should be.
    """
    return _Packer(config).packed()


def unpack(files: Mapping[str, bytes], folder: Path) -> Path:
    """Writes packed files into a folder.

    Returns:
        The configuration's file.

    Raises:
        ModelError: A name leads out of the folder.
        OSError: A file cannot be written.
    """
    for name, data in files.items():
        if Path(name).name != name:
            raise ModelError(f"a packed file is called {name!r}; expected a plain name")
        (folder / name).write_bytes(data)
    return folder / CONFIG


def load_packed(files: Mapping[str, bytes], folder: Path, overlay: str | None = None) -> CellConfig:
    """Reads a packed configuration.

    Args:
        files: As ``pack`` returned them.
        folder: An empty folder, in which they must stay until the cell is built.
        overlay: YAML that overlays the configuration.

    Raises:
        ConfigError: The configuration or the overlay is not what was expected.
    """
    paths = [unpack(files, folder)]
    if overlay is not None:
        paths.append(folder / "overlay.yaml")
        paths[-1].write_text(overlay, encoding="utf-8")
    return load_config(paths)


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
        meshes = root.findall("link/collision/geometry/mesh")
        for mesh in meshes:
            mesh.set("filename", self._mesh(mesh.get("filename", ""), path.parent, packages))
        return self._add(f"{robot}.urdf", ET.tostring(root) if meshes else data)

    def _shape(self, key: tuple[str, ...], shape: dict[str, Any], packages: Mapping[str, Path]) -> None:
        if shape.get("mesh"):
            folder = self._config.file((*key, "shape", "mesh", "file"), "")
            shape["mesh"]["file"] = self._mesh(shape["mesh"]["file"], folder, packages)

    def _mesh(self, uri: str, folder: Path, packages: Mapping[str, Path]) -> str:
        from armgate.cell.mesh.files import locate  # noqa: PLC0415  (most cells have no meshes)

        path = locate(uri, folder, packages)
        return self._add(path.name, path.read_bytes())

    def _add(self, name: str, data: bytes) -> str:
        """Keeps a file under its name, or under another one if the name is taken by other content."""
        stem, number = name, 1
        while self._files.get(name, data) != data or name == CONFIG:
            number += 1
            name = f"{number}-{stem}"
        self._files[name] = data
        return name
