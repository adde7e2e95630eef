"""The cell: robots and surroundings under one gate, built from a configuration."""

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.cell.bounds import joint_bounds, joint_lags, lag_difference, start_position
from armgate.cell.config import CellConfig, RobotConfig
from armgate.cell.configured_parts import parts_of_shape
from armgate.cell.errors import ModelError
from armgate.cell.findings import MAX_FINDINGS, Findings
from armgate.cell.gantry import GANTRY_LINKS, add_body, add_frame, add_gantry
from armgate.cell.model import RobotModel
from armgate.cell.names import whole_name
from armgate.cell.pairs import (
    Body,
    Pair,
    PairKind,
    collect_bodies,
    collect_pairs,
    collect_surroundings,
)
from armgate.cell.plain_file import read_file
from armgate.cell.source import Path_
from armgate.cell.urdf import check_counts, parse_xml, plain_origins, read_robot, unique_bodies
from armgate.cell.urdf_xml import MAX_BYTES, decoded

__all__ = ["Body", "Cell", "Pair", "PairKind", "Robot", "build_cell"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Robot:
    """One robot of the cell.

    Attributes:
        name: Its name in the cell.
        model: Its kinematics and bodies, base included.
        urdf: The composed URDF: arm, gantry, extra frames and bodies.
        period: Of its clock, s.
        lower: Joint limits, (n,), read-only, rad or m.
        upper: Joint limits, (n,), read-only, rad or m.
        velocity: Largest speeds, (n,), read-only, per s.
        acceleration: Largest accelerations, (n,), read-only, per s².
        deceleration: Decelerations of a stop, (n,), read-only, per s²; inf: no bound.
        start: Where it starts, (n,), read-only.
        lags: Time constants with which its joints follow their setpoints, as its link has them, s.
        lag_window: Declared transport delay of its link, s.
        lag_difference: Largest difference between the lags of two of its axes, s.
        q_tolerance: Rounding of the measured q, rad or m.
        tool: Name of the frame of its working point.
        camera: Name of its camera's frame, if it has one.
        config: What it was built from.
    """

    name: str
    model: RobotModel
    urdf: str
    period: float
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    deceleration: Array
    start: Array
    lags: tuple[float, ...]
    lag_window: float
    lag_difference: float
    q_tolerance: float
    tool: str
    camera: str | None
    config: RobotConfig


@dataclass(frozen=True, eq=False)
class Cell:
    """Robots and surroundings under one gate.

    Attributes:
        name: Its name.
        config: What it was built from.
        robots: In the order of the configuration.
        bodies: The robots' first, robot by robot, then the surroundings.
        pairs: Which bodies must stay apart.
        hash: SHA-256 of the resolved configuration and URDFs, the same on every machine: neither paths nor
            where the cell is served enter.
    """

    name: str
    config: CellConfig
    robots: tuple[Robot, ...]
    bodies: tuple[Body, ...]
    pairs: tuple[Pair, ...]
    hash: str

    @property
    def surroundings(self) -> tuple[Body, ...]:
        """The bodies that belong to no robot."""
        return tuple(body for body in self.bodies if body.robot is None)

    def robot_index(self, name: str) -> int:
        """Index of the robot of this name.

        Raises:
            ModelError: There is none.
        """
        names = [robot.name for robot in self.robots]
        if name not in names:
            raise ModelError(
                f"there is no robot {name!r} in cell {self.name!r}; expected one of {', '.join(names)}"
            )
        return names.index(name)

    def robot(self, name: str) -> Robot:
        """The robot of this name.

        Raises:
            ModelError: There is none.
        """
        return self.robots[self.robot_index(name)]


def build_cell(config: CellConfig) -> Cell:
    """Build the cell: read the URDFs, add gantries, frames and bodies, and check what needs the models.

    Meshes are cut last, which may take minutes: all else is checked before.

    Raises:
        ConfigError: A URDF is refused, or a value does not fit its robot; a line for each finding, with file,
            line and key.
    """
    if _has_meshes(config):
        _built(config, outline=True)
    return _built(config, outline=False)


def _has_meshes(config: CellConfig) -> bool:
    shapes = [own.shape for own in config.surroundings.values()]
    shapes += [body.shape for own in config.robots.values() for body in own.bodies.values()]
    paths = map(config.urdf_path, config.robots)
    return any(shape.mesh is not None for shape in shapes) or any(map(_mentions_mesh, paths))


def _mentions_mesh(path: Path) -> bool:
    try:
        return b"<mesh" in read_file(path, MAX_BYTES)
    except ModelError:  # reported where it is read
        return False


def _built(config: CellConfig, outline: bool) -> Cell:
    """Build the cell; in the outline small bodies stand in for meshes."""
    findings, robots = Findings(), []
    for name in config.robots:
        with findings.collecting():
            robots.append(_robot(config, name, outline))
    surroundings = collect_surroundings(config, outline, findings)
    findings.check(MAX_FINDINGS)
    models = [robot.model for robot in robots]
    bodies = collect_bodies(config, models, surroundings)
    pairs = collect_pairs(config, models, bodies)
    return Cell(config.name, config, tuple(robots), bodies, pairs, _hash(config, tuple(robots), bodies))


def _robot(config: CellConfig, name: str, outline: bool) -> Robot:
    """Build one robot.

    Raises:
        ConfigError: A line for each finding.
    """
    findings, own = Findings(), config.robots[name]
    arm = _parsed(config, name)
    _check_frames(config, name, arm, findings)
    with findings.collecting():
        urdf = _composed(config, name, arm, outline)
        with _blaming(config, ("robots", name, "urdf")):
            model = RobotModel.from_urdf(urdf, own.base.placement)
        with findings.collecting():
            bounds = joint_bounds(config, name, model)
        with findings.collecting():
            lags = joint_lags(config, name, model)
        start = start_position(config, name, model)
    findings.check()
    return Robot(
        name=name,
        model=model,
        urdf=urdf,
        period=own.period,
        lower=bounds.lower,
        upper=bounds.upper,
        velocity=bounds.velocity,
        acceleration=bounds.acceleration,
        deceleration=bounds.deceleration,
        start=start,
        lag_window=own.lag_window,
        lags=lags,
        lag_difference=lag_difference(config, name, lags),
        q_tolerance=own.q_tolerance,
        tool=own.tool,
        camera=own.camera,
        config=own,
    )


def _parsed(config: CellConfig, name: str) -> ET.Element:
    path, key = config.urdf_path(name), ("robots", name, "urdf")
    try:
        data = read_file(path, MAX_BYTES)
    except ModelError as error:
        raise config.error(key, f"{path} {error}") from error
    with _blaming(config, key, f"{path}: "):
        robot = parse_xml(decoded(data))
        check_counts(robot)
        return robot


def _composed(config: CellConfig, name: str, robot: ET.Element, outline: bool) -> str:
    path, key = config.urdf_path(name), ("robots", name, "urdf")
    with _blaming(config, key, f"{path}: "):
        unique_bodies(robot)
        read_robot(robot, meshes=True)
        plain_origins(robot)
        if config.robots[name].meshes.bodies or robot.find("link/collision/geometry/mesh") is not None:
            _inline_meshes(config, name, robot, path.parent, outline)
        read_robot(robot)
    _add_parts(config, name, robot, outline)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def _inline_meshes(config: CellConfig, name: str, robot: ET.Element, folder: Path, outline: bool) -> None:
    from armgate.cell.mesh.urdf import inline_meshes  # noqa: PLC0415  (most cells have no meshes)

    inline_meshes(robot, folder, config.robots[name].meshes, _packages(config, name), outline)


def _packages(config: CellConfig, name: str) -> dict[str, Path]:
    key = ("robots", name, "meshes", "packages")
    given = config.robots[name].meshes.packages
    return {package: config.file((*key, package), folder) for package, folder in given.items()}


def _add_parts(config: CellConfig, name: str, robot: ET.Element, outline: bool) -> None:
    """Add gantry, frames and bodies, one by one so that an error names the right one."""
    own, key, findings = config.robots[name], ("robots", name), Findings()
    if own.gantry is not None:
        with findings.collecting(), _blaming(config, (*key, "gantry")):
            add_gantry(robot, own.gantry)
    for frame, frame_config in own.frames.items():
        with findings.collecting(), _blaming(config, (*key, "frames", frame)):
            add_frame(robot, frame, frame_config)
    for body, body_config in own.bodies.items():
        with findings.collecting(), _blaming(config, (*key, "bodies", body)):
            folder = config.file((*key, "bodies", body, "shape", "mesh", "file"), "")
            parts = parts_of_shape(body_config.shape, folder, _packages(config, name), outline)
            add_body(robot, body, body_config, parts)
    findings.check()


@contextmanager
def _blaming(config: CellConfig, path: Path_, before: str = "") -> Iterator[None]:
    """Turn each line of a ModelError into a finding about the value under ``path``."""
    try:
        yield
    except ModelError as error:
        findings = Findings()
        for line in str(error).splitlines():
            with findings.collecting():
                raise config.error(path, f"{before}{line}") from error
        findings.check()


def _check_frames(config: CellConfig, name: str, arm: ET.Element, findings: Findings) -> None:
    """Check that tool and camera are links of the arm, of the gantry or configured frames."""
    own = config.robots[name]
    links = [link.get("name", "") for link in arm.findall("link")]
    known = [*links, *(GANTRY_LINKS if own.gantry is not None else ()), *own.frames]
    for key, frame in (("tool", own.tool), ("camera", own.camera)):
        if frame is not None and frame not in known:
            with findings.collecting():
                text = f"there is no frame {frame!r}; expected one of {', '.join(known)}"
                raise config.error(("robots", name, key), text)


def _hash(config: CellConfig, robots: tuple[Robot, ...], bodies: tuple[Body, ...]) -> str:
    """Over values, not texts: comments, units, paths and where the cell is served do not change it."""
    resolved = config.model_dump(mode="json", exclude={"server": True, "recording": True, "metrics": True})
    _without_files(resolved, bodies)
    for robot in robots:
        own = resolved["robots"][robot.name]
        own["urdf"] = robot.urdf
        own["start"] = robot.start.tolist()
        bounds = (robot.lower, robot.upper, robot.velocity, robot.acceleration, robot.deceleration)
        own["joints"] = [[repr(float(value)) for value in bound] for bound in bounds]
    text = json.dumps(resolved, sort_keys=True, separators=(",", ":"))
    order = json.dumps([robot.name for robot in robots])
    return hashlib.sha256(f"{order}\n{text}".encode()).hexdigest()


def _without_files(resolved: dict[str, Any], bodies: tuple[Body, ...]) -> None:
    """Puts what meshes have become in the place of their files; a robot's are in its composed URDF."""
    for own in resolved["robots"].values():
        del own["meshes"]
        for key in ("ethernet", "krc", "listen"):
            own["link"].pop(key, None)
        own["bodies"] = {name: body for name, body in own["bodies"].items() if "mesh" not in body["shape"]}
    for name, own in resolved["surroundings"].items():
        if "mesh" in own["shape"]:
            parts = (body for body in bodies if body.robot is None and whole_name(body.name) == name)
            own["shape"]["mesh"] = [(asdict(part.shape), part.placement.t.tolist()) for part in parts]
