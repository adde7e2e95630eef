"""What an input wants of the robot at a tick, and what it may know for that."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.cell.placement import Placement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointRate:
    """Joints shall move at these shares of the leader's largest speeds (n,), each −1 to 1."""

    share: Array


@dataclass(frozen=True)
class JointTarget:
    """Joints shall come to these positions and rest there (n,), rad or m."""

    q: Array


@dataclass(frozen=True)
class ToolTwist:
    """The tool shall move at these shares of the leader's largest tool speeds (6,), each −1 to 1.

    Linear at the tool's origin, then angular, world axes.
    """

    share: Array


@dataclass(frozen=True)
class ToolTarget:
    """The tool shall come to this place in the world and rest there."""

    place: Placement


Motion = JointRate | JointTarget | ToolTwist | ToolTarget


@dataclass(frozen=True)
class MotionRequest:
    """What is wanted now.

    Attributes:
        motion: Where to; None: rest. A deadman switch that is not held is None.
        ended: Why nothing more will be wanted, "": it goes on. The robot is brought to rest first.
        failed: Whether it ended otherwise than its user wished.
    """

    motion: Motion | None = None
    ended: str = ""
    failed: bool = False


@dataclass(frozen=True)
class RobotState:
    """What an input may know of its robot.

    Attributes:
        time: Daemon time of the tick, s.
        setpoint: The commanded position (n,), rad or m.
        q: The measured one (n,), rad or m.
        others: Measured positions of the cell's other robots by name.
    """

    time: float
    setpoint: Array
    q: Array
    others: Mapping[str, Array] = field(default_factory=dict)
