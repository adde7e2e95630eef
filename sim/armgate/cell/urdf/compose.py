"""Composition of a robot's URDF: the file of the arm, and gantry, frames and bodies of the configuration.

The result is one URDF text that needs no other files: meshes become convex bodies in it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from armgate.cell.bodies import parts_of_shape
from armgate.cell.config import BodyConfig, CellConfig, FrameConfig
from armgate.cell.config.yaml_tree import KeyPath
from armgate.cell.errors import ErrorCollector, ModelError
from armgate.cell.regular_file import read_file
from armgate.cell.shapes import ShapePart
from armgate.cell.urdf.bodies import make_names_unique, write_parts
from armgate.cell.urdf.elements import add_joint, add_link, require_link
from armgate.cell.urdf.gantry import add_gantry
from armgate.cell.urdf.normalize import replace_quaternions
from armgate.cell.urdf.reader import check_counts, read_robot
from armgate.cell.urdf.xml_tree import MAX_BYTES, decode, parse_xml


def parse_arm(config: CellConfig, name: str) -> ET.Element:
    """Return the ``<robot>`` element of a robot's URDF file.

    Raises:
        ConfigError: The file cannot be read, or is not XML.
    """
    path, key = config.urdf_path(name), ("robots", name, "urdf")
    try:
        data = read_file(path, MAX_BYTES)
    except ModelError as error:
        raise config.error(key, f"{path} {error}") from error
    with located(config, key, f"{path}: "):
        robot = parse_xml(decode(data))
        check_counts(robot)
        return robot


def compose_urdf(config: CellConfig, name: str, robot: ET.Element, outline: bool) -> str:
    """Return the text of a robot's composed URDF.

    Args:
        config: Configuration of the cell.
        name: Name of the robot.
        robot: The ``<robot>`` element of its file; changed in place.
        outline: If true, check meshes without cutting them: small bodies replace their parts.

    Raises:
        ConfigError: The URDF or an addition is refused; a line for each error.
    """
    path, key = config.urdf_path(name), ("robots", name, "urdf")
    with located(config, key, f"{path}: "):
        make_names_unique(robot)
        read_robot(robot, meshes=True)
        replace_quaternions(robot)
        if config.robots[name].meshes.bodies or robot.find("link/collision/geometry/mesh") is not None:
            _inline_meshes(config, name, robot, path.parent, outline)
        read_robot(robot)
    _add_configured(config, name, robot, outline)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


@contextmanager
def located(config: CellConfig, path: KeyPath, before: str = "") -> Iterator[None]:
    """Convert each line of a ModelError to a ConfigError about the value under ``path``."""
    try:
        yield
    except ModelError as error:
        errors = ErrorCollector()
        for line in str(error).splitlines():
            with errors.collecting():
                raise config.error(path, f"{before}{line}") from error
        errors.check()


def _inline_meshes(config: CellConfig, name: str, robot: ET.Element, folder: Path, outline: bool) -> None:
    from armgate.cell.urdf.meshes import inline_meshes  # noqa: PLC0415  (most cells have no meshes)

    inline_meshes(robot, folder, config.robots[name].meshes, _packages(config, name), outline)


def _packages(config: CellConfig, name: str) -> dict[str, Path]:
    key = ("robots", name, "meshes", "packages")
    given = config.robots[name].meshes.packages
    return {package: config.file((*key, package), folder) for package, folder in given.items()}


def _add_configured(config: CellConfig, name: str, robot: ET.Element, outline: bool) -> None:
    """Add gantry, frames and bodies, one by one, so that an error names the right one."""
    own, key, errors = config.robots[name], ("robots", name), ErrorCollector()
    if own.gantry is not None:
        with errors.collecting(), located(config, (*key, "gantry")):
            add_gantry(robot, own.gantry)
    for frame, frame_config in own.frames.items():
        with errors.collecting(), located(config, (*key, "frames", frame)):
            _add_frame(robot, frame, frame_config)
    for body, body_config in own.bodies.items():
        with errors.collecting(), located(config, (*key, "bodies", body)):
            folder = config.file((*key, "bodies", body, "shape", "mesh", "file"), "")
            parts = parts_of_shape(body_config.shape, folder, _packages(config, name), outline)
            _add_body(robot, body, body_config, parts)
    errors.check()


def _add_frame(robot: ET.Element, name: str, frame: FrameConfig) -> None:
    require_link(robot, frame.parent)
    add_link(robot, name)
    add_joint(robot, f"{name}_mount", "fixed", (frame.parent, name), (frame.xyz, frame.rpy))
    read_robot(robot)  # the name of its joint can be taken


def _add_body(robot: ET.Element, name: str, body: BodyConfig, parts: Sequence[ShapePart]) -> None:
    write_parts(require_link(robot, body.link), name, parts, body.xyz, body.rpy)
    read_robot(robot)  # the name can be taken
