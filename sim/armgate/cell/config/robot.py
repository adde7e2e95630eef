"""Configuration of one robot: description, gantry, extra frames and bodies, joints, meshes and link."""

from typing import Annotated, Self

from pydantic import BeforeValidator, Field, SerializeAsAny, model_validator

from armgate.cell.config.fields import (
    Acceleration,
    ConfigModel,
    Duration,
    JointValue,
    Length,
    Name,
    Period,
    Size,
    SparseModel,
    Speed,
)
from armgate.cell.config.link import EmulatedLinkConfig, LinkConfig
from armgate.cell.config.link_kinds import read_link
from armgate.cell.config.shape import MeshesConfig, Pose, ShapeConfig


class FrameConfig(Pose):
    """Extra frame, fixed to a link."""

    parent: Name
    """Link in whose frame the pose is given."""


class BodyConfig(Pose):
    """Extra collision body, fixed to a link."""

    link: Name
    """Link in whose frame the pose is given."""
    shape: ShapeConfig
    """Shape of the body."""


Range = tuple[Length, Length]
"""Lower and upper end, m."""


class TravelConfig(ConfigModel):
    """Travel of the carriage along each axis of the gantry's frame."""

    x: Range
    """Lower and upper end of the travel along x [m]."""
    y: Range
    """Lower and upper end of the travel along y [m]."""
    z: Range
    """Lower and upper end of the travel along z [m]."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for axis, (lower, upper) in (("x", self.x), ("y", self.y), ("z", self.z)):
            if lower >= upper:
                raise ValueError(f"{axis} goes from {lower:g} to {upper:g}; expected the lower end first")
        return self


class GantryConfig(ConfigModel):
    """Three-axis gantry whose joints X, Y, Z are the carriage's position in the gantry's frame."""

    travel: TravelConfig
    """Limits of the joints X, Y and Z."""
    speed: Speed = 1.0
    """Largest speed of each axis [m/s]."""
    acceleration: Acceleration | None = None
    """Acceleration and deceleration of each axis [m/s²]; absent: speed / 0.25 s."""
    height: Size = 3.5
    """Height of the underside of rails and bridge [m]."""
    span: Size = 4.6
    """Distance between the centre lines of both rails [m]."""
    beam: Size = 0.3
    """Edge of the square section of rails, posts and bridge [m]."""
    column: Size = 0.2
    """Edge of the square section of the vertical column [m]."""
    mount: Pose = Pose()
    """Pose of the arm's root link in the frame of the carriage, which is the lower end of the column."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.travel.z[1] >= self.height:
            raise ValueError(
                f"the carriage's travel ends at {self.travel.z[1]:g} m, in the bridge; "
                f"expected travel.z below height ({self.height:g} m)"
            )
        inside = self.span / 2 - self.beam - self.column / 2
        if max(-self.travel.y[0], self.travel.y[1]) >= inside:
            raise ValueError(
                f"the carriage's travel {self.travel.y} runs into a rail; "
                f"expected travel.y within ±{inside:g} m or a larger span"
            )
        return self


class JointConfig(SparseModel):
    """Bounds of one joint that are tighter than those of the URDF; absent keys keep the URDF's bounds."""

    lower: JointValue | None = None
    """Lower limit [rad or m]."""
    upper: JointValue | None = None
    """Upper limit [rad or m]."""
    velocity: JointValue | None = None
    """Largest speed [rad/s or m/s]."""
    acceleration: JointValue | None = None
    """Largest acceleration [rad/s² or m/s²]; absent: velocity / 0.25 s."""
    deceleration: JointValue | None = None
    """Guaranteed deceleration [rad/s² or m/s²]; absent: velocity / 0.25 s; null: no bound."""


class RobotConfig(ConfigModel):
    """One robot of the cell."""

    urdf: str
    """File of the robot description (URDF), relative to the file that contains the key."""
    base: Pose = Pose()
    """Pose of the root link, or of the gantry, in the world."""
    gantry: GantryConfig | None = None
    """Gantry from which the arm hangs; absent: none."""
    frames: dict[Name, FrameConfig] = {}
    """Extra frames, by name."""
    bodies: dict[Name, BodyConfig] = {}
    """Extra collision bodies, by name."""
    tool: Name = "tool0"
    """Frame of the tool centre point."""
    camera: Name | None = None
    """Frame of the camera; absent: the robot has none."""
    start: tuple[JointValue, ...]
    """Initial position of an emulated robot, one value for each joint [rad or m]."""
    period: Annotated[Period, Field(ge=1e-4, le=10.0)] = 0.012
    """Period of the robot's clock [s]."""
    joints: dict[Name, JointConfig] = {}
    """Bounds tighter than those of the URDF, by joint name."""
    meshes: MeshesConfig = MeshesConfig()
    """Options for the meshes of the URDF."""
    ignore_pairs: tuple[tuple[Name, Name], ...] = ()
    """Unchecked pairs: links or bodies of this robot; the second may be one of ``surroundings``."""
    lag_window: Annotated[Duration, Field(ge=0.0)] = 0.0
    """Transport delay of the link: time in which older setpoints may still be in transit [s].

    It need not include the jitter of the ticks' time stamps."""
    lag_difference: Annotated[Duration, Field(ge=0.0)] | None = None
    """Largest difference between the lags of two axes [s].

    Absent: that of the emulated joints, or 10 % of ``link.lag`` for a real robot."""
    q_tolerance: Annotated[float, Field(ge=0.0, le=1.0)] = 1e-6
    """Largest rounding error of the measured position [rad or m]."""
    link: Annotated[SerializeAsAny[LinkConfig], BeforeValidator(read_link)] = EmulatedLinkConfig()
    """Connection to the robot; ``kind`` selects its type, which armgate or another package provides."""
