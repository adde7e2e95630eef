"""Configuration of the whole cell: strict models, read from overlaid YAML files.

Lengths and angles are numbers in m and rad, or texts with a unit (``50 mm``, ``-94 deg``). The values of a
joint are angles or lengths depending on its URDF, so they stay ``Quantity`` here and are checked in
``build_cell``. Unknown keys are refused. Reading needs no robot model: it works without pinocchio.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import AfterValidator, Field, PrivateAttr, ValidationError

from armgate.cell.config.daemon import (
    LockstepClockConfig,
    MetricsConfig,
    RecordingConfig,
    ServerConfig,
    WallClockConfig,
)
from armgate.cell.config.fields import ConfigModel, Name, Size
from armgate.cell.config.robot import RobotConfig
from armgate.cell.config.shape import Pose, ShapeConfig
from armgate.cell.config.validation_errors import to_config_error
from armgate.cell.config.yaml_tree import KeyPath, Node, config_error, read_tree
from armgate.cell.errors import ConfigError

VERSION = 1
MAX_ROBOTS = 32
MAX_SURROUNDINGS = 1024


def _known_version(version: int) -> int:
    if version != VERSION:
        raise ValueError(f"version {version} of the configuration is not known; expected {VERSION}")
    return version


class SurroundingConfig(Pose):
    """Body that stands still in the world."""

    shape: ShapeConfig
    """Shape of the body."""


class CellConfig(ConfigModel):
    """The whole cell."""

    armgate: Annotated[int, AfterValidator(_known_version)]
    """Version of the configuration format: 1."""
    name: Name
    """Name of the cell."""
    stop_distance: Size = 0.05
    """Smallest clearance between robots, and between robots and surroundings [m]."""
    self_distance: Size = 0.02
    """Smallest clearance between bodies of one robot [m]."""
    response: Literal["stop", "slow"] = "stop"
    """Response to a command that would bring the robot too near to another body.

    ``stop`` refuses the command, and the robot brakes; ``slow`` admits the part that keeps the distance."""
    max_age_ticks: Annotated[int, Field(ge=1, le=1000)] = 3
    """Largest age of the state on which a command is based [ticks].

    Raise it for clients with slow connections."""
    robots: Annotated[dict[Name, RobotConfig], Field(min_length=1, max_length=MAX_ROBOTS)]
    """Robots by name; in lock-step, commands are decided in this order."""
    surroundings: Annotated[dict[Name, SurroundingConfig], Field(max_length=MAX_SURROUNDINGS)] = {}
    """Bodies that stand still in the world, by name."""
    clock: Annotated[WallClockConfig | LockstepClockConfig, Field(discriminator="kind")] = WallClockConfig()
    """Clock of the robots: wall clock or lock-step."""
    server: ServerConfig = ServerConfig()
    """Addresses and limits of the daemon."""
    recording: RecordingConfig = RecordingConfig()
    """Recording of events, outputs and states."""
    metrics: MetricsConfig = MetricsConfig()
    """Metrics for Prometheus."""

    _tree: Node | None = PrivateAttr(default=None)

    def error(self, path: KeyPath, text: str) -> ConfigError:
        """Return a ``ConfigError`` about the value under these keys, with file and line if they are known."""
        return config_error(None if self._tree is None else self._tree.locate(path), path, text)

    def urdf_path(self, robot: str) -> Path:
        """Return the path of a robot's URDF; relative paths start at the file that contains them."""
        return self.file(("robots", robot, "urdf"), self.robots[robot].urdf)

    def file(self, path: KeyPath, given: str) -> Path:
        """Return the path given under these keys; relative paths start at the file that contains them."""
        if self._tree is None:
            return Path(given)
        return self._tree.locate(path).file.parent / given


def load_config(paths: Sequence[Path]) -> CellConfig:
    """Read a configuration; later files overlay earlier ones.

    Raises:
        ConfigError: A file cannot be read, is malformed, or a value is not what was expected; the text gives
            file, line, key and expectation of every error.
    """
    return config_of(read_tree(paths))


def config_of(tree: Node) -> CellConfig:
    """Return the configuration in a tree, whose marks are the places in error messages.

    Raises:
        ConfigError: A value is not what was expected, as in `load_config`.
    """
    try:
        config = CellConfig.model_validate(tree.plain())
    except ValidationError as error:
        raise to_config_error(error, tree, CellConfig) from error
    config._tree = tree
    return config


def dump_config(config: CellConfig) -> str:
    """Return the configuration as one YAML file with all defaults; paths stay as they were given."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
