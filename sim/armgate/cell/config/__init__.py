"""Configuration of a cell: models, units, strict YAML with overlays, and packing into one folder."""

from armgate.cell.config.cell import CellConfig, SurroundingConfig, config_of, dump_config, load_config
from armgate.cell.config.daemon import (
    LockstepClockConfig,
    MetricsConfig,
    RecordingConfig,
    ServerConfig,
    SignalRuleConfig,
    SocketConfig,
    TlsConfig,
    WallClockConfig,
)
from armgate.cell.config.in_lockstep import in_lockstep
from armgate.cell.config.robot import BodyConfig, FrameConfig, GantryConfig, JointConfig, RobotConfig
from armgate.cell.config.shape import MeshConfig, MeshesConfig, MeshOptions, Pose, ShapeConfig

__all__ = [
    "BodyConfig",
    "CellConfig",
    "FrameConfig",
    "GantryConfig",
    "JointConfig",
    "LockstepClockConfig",
    "MeshConfig",
    "MeshOptions",
    "MeshesConfig",
    "MetricsConfig",
    "Pose",
    "RecordingConfig",
    "RobotConfig",
    "ServerConfig",
    "ShapeConfig",
    "SignalRuleConfig",
    "SocketConfig",
    "SurroundingConfig",
    "TlsConfig",
    "WallClockConfig",
    "config_of",
    "dump_config",
    "in_lockstep",
    "load_config",
]
