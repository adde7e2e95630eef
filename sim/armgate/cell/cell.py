"""The cell: robots and surroundings under one gate, built from a configuration."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.cell.bodies import Body, collect_bodies, collect_surroundings
from armgate.cell.cell_hash import cell_hash
from armgate.cell.config import CellConfig, RobotConfig
from armgate.cell.errors import MAX_LINES, ErrorCollector, ModelError
from armgate.cell.joint_bounds import joint_bounds, joint_lags, lag_difference, start_position
from armgate.cell.model import RobotModel
from armgate.cell.pairs import Pair, PairKind, collect_pairs
from armgate.cell.regular_file import read_file
from armgate.cell.urdf.compose import compose_urdf, located, parse_arm
from armgate.cell.urdf.gantry import GANTRY_LINKS
from armgate.cell.urdf.xml_tree import MAX_BYTES

__all__ = ["Body", "Cell", "Pair", "PairKind", "Robot", "build_cell"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Robot:
    """One robot of the cell.

    Attributes:
        name: Name in the cell.
        model: Kinematics and bodies, base included.
        urdf: Composed URDF: arm, gantry, extra frames and bodies.
        period: Period of its clock, s.
        lower: Lower joint limits, (n,), read-only, rad or m.
        upper: Upper joint limits, (n,), read-only, rad or m.
        velocity: Largest speeds, (n,), read-only, per s.
        acceleration: Largest accelerations, (n,), read-only, per s².
        deceleration: Decelerations of a stop, (n,), read-only, per s²; inf: no bound.
        start: Initial position, (n,), read-only, rad or m.
        lags: Time constants with which its joints follow their setpoints, from its link, s.
        lag_window: Declared transport delay of its link, s.
        lag_difference: Largest difference between the lags of two of its axes, s.
        q_tolerance: Rounding of the measured q, rad or m.
        tool: Name of the frame of the tool centre point.
        camera: Name of the frame of its camera, None if it has none.
        config: Configuration of the robot.
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
        name: Name of the cell.
        config: Configuration of the cell.
        robots: Robots in the order of the configuration.
        bodies: Bodies of the robots, robot by robot, then the surroundings.
        pairs: Pairs of bodies that must stay apart.
        hash: SHA-256 of the resolved configuration and URDFs, see ``cell_hash``.
    """

    name: str
    config: CellConfig
    robots: tuple[Robot, ...]
    bodies: tuple[Body, ...]
    pairs: tuple[Pair, ...]
    hash: str

    @property
    def surroundings(self) -> tuple[Body, ...]:
        """Bodies that belong to no robot."""
        return tuple(body for body in self.bodies if body.robot is None)

    def robot_index(self, name: str) -> int:
        """Return the index of the robot of this name.

        Raises:
            ModelError: There is no such robot.
        """
        try:
            return self._indices[name]
        except KeyError:
            known = ", ".join(self._indices)
            raise ModelError(
                f"there is no robot {name!r} in cell {self.name!r}; expected one of {known}"
            ) from None

    @cached_property
    def _indices(self) -> dict[str, int]:
        return {robot.name: index for index, robot in enumerate(self.robots)}

    def robot(self, name: str) -> Robot:
        """Return the robot of this name.

        Raises:
            ModelError: There is no such robot.
        """
        return self.robots[self.robot_index(name)]


def build_cell(config: CellConfig) -> Cell:
    """Build the cell: read the URDFs, add gantries, frames and bodies, and check values against the models.

    Meshes are cut last, because that may take minutes: everything else is checked before.

    Raises:
        ConfigError: A URDF is refused, or a value does not fit its robot; a line for each error, with file,
            line and key.
    """
    if _has_meshes(config):
        _build(config, outline=True)
    return _build(config, outline=False)


def _has_meshes(config: CellConfig) -> bool:
    shapes = [own.shape for own in config.surroundings.values()]
    shapes += [body.shape for own in config.robots.values() for body in own.bodies.values()]
    paths = map(config.urdf_path, config.robots)
    return any(shape.mesh is not None for shape in shapes) or any(map(_mentions_mesh, paths))


def _mentions_mesh(path: Path) -> bool:
    try:
        return b"<mesh" in read_file(path, MAX_BYTES)
    except ModelError:  # reported when the file is read for its content
        return False


def _build(config: CellConfig, outline: bool) -> Cell:
    """Build the cell; in the outline, small bodies replace the parts of meshes."""
    errors, robots = ErrorCollector(), []
    for name in config.robots:
        with errors.collecting():
            robots.append(_build_robot(config, name, outline))
    surroundings = collect_surroundings(config, outline, errors)
    errors.check(MAX_LINES)
    models = [robot.model for robot in robots]
    bodies = collect_bodies(config, models, surroundings)
    pairs = collect_pairs(config, models, bodies)
    return Cell(config.name, config, tuple(robots), bodies, pairs, cell_hash(config, robots, bodies))


def _build_robot(config: CellConfig, name: str, outline: bool) -> Robot:
    """Build one robot.

    Raises:
        ConfigError: A line for each error.
    """
    errors, own = ErrorCollector(), config.robots[name]
    arm = parse_arm(config, name)
    _check_frames(config, name, arm, errors)
    with errors.collecting():
        urdf = compose_urdf(config, name, arm, outline)
        with located(config, ("robots", name, "urdf")):
            model = RobotModel.from_urdf(urdf, own.base.placement)
        with errors.collecting():
            bounds = joint_bounds(config, name, model)
        with errors.collecting():
            lags = joint_lags(config, name, model)
        start = start_position(config, name, model)
    errors.check()
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


def _check_frames(config: CellConfig, name: str, arm: ET.Element, errors: ErrorCollector) -> None:
    """Check that tool and camera are links of the arm or of the gantry, or configured frames."""
    own = config.robots[name]
    links = [link.get("name", "") for link in arm.findall("link")]
    known = [*links, *(GANTRY_LINKS if own.gantry is not None else ()), *own.frames]
    for key, frame in (("tool", own.tool), ("camera", own.camera)):
        if frame is not None and frame not in known:
            with errors.collecting():
                text = f"there is no frame {frame!r}; expected one of {', '.join(known)}"
                raise config.error(("robots", name, key), text)
