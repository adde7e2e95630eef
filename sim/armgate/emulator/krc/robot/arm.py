"""Robot of a virtual KRC: its axes in the KRC's units (deg, mm), its start and its kinematics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.robot.kinematics import IDENTITY, Chain, Matrix, Segment, Vector
from armgate.emulator.krc.rsi.ethernet import A_AXES, E_AXES

if TYPE_CHECKING:
    from armgate.cell.cell import Robot
    from armgate.cell.urdf import Urdf, UrdfJoint

RISE = 0.25
"""Time in which an axis reaches its full speed by default, s (assumed)."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis; its values are in deg, or in mm if it is linear.

    Attributes:
        name: Name, A1 to A6 or E1 to E6.
        linear: True for a linear axis.
        lower: Lower end of its range.
        upper: Upper end of its range.
        speed: Largest speed, per s.
        acceleration: Largest acceleration, per s².
    """

    name: str
    linear: bool
    lower: float
    upper: float
    speed: float
    acceleration: float

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "mm" if self.linear else "deg"


@dataclass(frozen=True)
class Arm:
    """Robot.

    Attributes:
        axes: Axes, A1… first, then E1….
        start: Position of each axis when the controller is switched on.
        chain: Chain from the arm's foot (ROBROOT) to its flange; external axes do not move it.
    """

    axes: tuple[Axis, ...]
    start: tuple[float, ...]
    chain: Chain

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(axis.name for axis in self.axes)

    def starting(self, start: Sequence[float]) -> "Arm":
        """Return the same robot with another start.

        Raises:
            KrcError: There is not one finite value for each axis.
        """
        if len(start) != len(self.axes) or not all(map(math.isfinite, start)):
            names = ", ".join(self.names)
            raise KrcError(f"start with {len(start)} values; expected {len(self.axes)} finite ones: {names}")
        return replace(self, start=tuple(start))


# Public figures of the KR 16-2: origin in the frame before [mm], axis, range [deg], speed [deg/s].
_KR16: tuple[tuple[Vector, Vector, float, float, float], ...] = (
    ((0.0, 0.0, 675.0), (0.0, 0.0, -1.0), -185.0, 185.0, 156.0),
    ((260.0, 0.0, 0.0), (0.0, 1.0, 0.0), -155.0, 35.0, 156.0),
    ((680.0, 0.0, 0.0), (0.0, 1.0, 0.0), -130.0, 154.0, 156.0),
    ((670.0, 0.0, -35.0), (-1.0, 0.0, 0.0), -350.0, 350.0, 330.0),
    ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), -130.0, 130.0, 330.0),
    ((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), -350.0, 350.0, 615.0),
)
_FLANGE = Segment(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)), (158.0, 0.0, 0.0), None)
_UPRIGHT = (0.0, -90.0, 90.0, 0.0, 90.0, 0.0)


def kr16() -> Arm:
    """Return a KR 16-2, upright, with its flange pointing down."""
    axes = tuple(
        Axis(name, False, lower, upper, speed, speed / RISE)
        for name, (_, _, lower, upper, speed) in zip(A_AXES, _KR16, strict=True)
    )
    segments = [Segment(IDENTITY, origin, axis) for origin, axis, *_ in _KR16]
    return Arm(axes, _UPRIGHT, Chain([*segments, _FLANGE]))


def arm_of_urdf(urdf: "Urdf", tool: str) -> Arm:
    """Return a robot from its description: prismatic joints before the arm are E1…, revolute ones A1….

    Raises:
        KrcError: Its joints do not form such a chain.
    """
    joints = _path(urdf, tool)
    moving = [joint for joint in joints if joint.kind != "fixed"]
    external = [joint for joint in moving if joint.kind == "prismatic"]
    inner = moving[len(external) :]
    fits = moving[: len(external)] == external and 1 <= len(inner) <= len(A_AXES)
    if not fits or len(external) > len(E_AXES):
        kinds = ", ".join(f"{joint.name} {joint.kind}" for joint in moving)
        wanted = "expected up to 6 prismatic, then 1 to 6 revolute ones"
        raise KrcError(f"the joints {kinds} are not those of a KUKA robot; {wanted}")
    named = [*zip(A_AXES, inner, strict=False), *zip(E_AXES, external, strict=False)]
    axes = tuple(_axis(name, joint) for name, joint in named)
    chain = Chain([_segment(joint) for joint in joints[joints.index(inner[0]) :]])
    return Arm(axes, (0.0,) * len(axes), chain)


def arm_of_cell(robot: "Robot", urdf: "Urdf") -> Arm:
    """Return a robot of a cell, with the cell's speeds, accelerations and start.

    The drives reach the larger one of the configured acceleration and deceleration.

    Raises:
        KrcError: Its joints are not those of a KUKA robot.
    """
    arm = arm_of_urdf(urdf, robot.tool)
    if robot.model.n != len(arm.axes):
        raise KrcError(
            f"{robot.name} has joints other than those of its tool {robot.tool!r}; expected one chain"
        )
    count = sum(axis.linear for axis in arm.axes)
    # The model's order is E1…, A1…; `Arm` begins with the A axes.
    order = [*range(count, robot.model.n), *range(count)]
    axes, start = [], []
    for axis, index in zip(arm.axes, order, strict=True):
        factor = 1000.0 if axis.linear else math.degrees(1.0)
        bounds = (float(robot.acceleration[index]), float(robot.deceleration[index]))
        hardest = max(bound for bound in bounds if math.isfinite(bound))
        speed = factor * float(robot.velocity[index])
        axes.append(replace(axis, speed=speed, acceleration=factor * hardest))
        start.append(factor * float(robot.start[index]))
    return replace(arm, axes=tuple(axes)).starting(start)


def _path(urdf: "Urdf", tool: str) -> list["UrdfJoint"]:
    """Return the joints from the root to a link."""
    if tool not in urdf.links:
        raise KrcError(f"there is no link {tool!r}; expected one of {', '.join(urdf.links)}")
    parents = {joint.child: joint for joint in urdf.joints}
    path: list[UrdfJoint] = []
    while tool in parents:
        path.insert(0, parents[tool])
        tool = parents[tool].parent
    return path


def _axis(name: str, joint: "UrdfJoint") -> Axis:
    linear = joint.kind == "prismatic"
    factor = 1000.0 if linear else math.degrees(1.0)
    speed = factor * joint.velocity
    return Axis(name, linear, factor * joint.lower, factor * joint.upper, speed, speed / RISE)


def _segment(joint: "UrdfJoint") -> Segment:
    rows: Matrix = joint.origin.R.tolist()
    x, y, z = (1000.0 * float(value) for value in joint.origin.t)
    return Segment(rows, (x, y, z), None if joint.kind == "fixed" else joint.axis)
