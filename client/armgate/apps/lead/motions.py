"""Motions that an input requests of a robot at a tick, and the robot state that it receives."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.cell.placement import Placement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointRate:
    """Joint velocities as shares of the leader's largest speeds (n,), each −1 to 1."""

    share: Array


@dataclass(frozen=True)
class JointTarget:
    """Joint positions to reach and rest at (n,), rad or m."""

    q: Array


@dataclass(frozen=True)
class ToolTwist:
    """Tool velocity as shares of the leader's largest tool speeds (6,), each −1 to 1.

    Linear velocity of the tool's origin, then angular velocity, world axes.
    """

    share: Array


@dataclass(frozen=True)
class ToolTarget:
    """Tool pose in the world to reach and rest at."""

    place: Placement


Motion = JointRate | JointTarget | ToolTwist | ToolTarget


@dataclass(frozen=True)
class MotionRequest:
    """Request of an input at one tick.

    Attributes:
        motion: Requested motion; None to rest, for example while a deadman switch is released.
        ended: Reason why the input has ended; "" while it continues. The robot is brought to rest first.
        failed: True if the input ended for another reason than its user's request.
    """

    motion: Motion | None = None
    ended: str = ""
    failed: bool = False


@dataclass(frozen=True)
class RobotState:
    """State of an input's robot at one tick.

    Attributes:
        time: Daemon time of the tick, s.
        setpoint: Commanded position (n,), rad or m.
        q: Measured position (n,), rad or m.
        others: Measured positions of the other robots of the cell, by name.
    """

    time: float
    setpoint: Array
    q: Array
    others: Mapping[str, Array] = field(default_factory=dict)
