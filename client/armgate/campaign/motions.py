"""Programs for campaigns that need no model of the robot: a swinging joint, and a motion to a position."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armgate.client import BadArgument, RobotDescription
from armgate.client.program import ProgramContext, TickProgram
from armgate.client.tick import Tick

Array = NDArray[np.float64]


class Swing(TickProgram):
    """Program that swings one joint between its start and an end, from rest: start + A (1 − cos ωt) / 2.

    Args:
        robot: The robot.
        joint: Index of the joint.
        amplitude: Distance A of the end from the start, with sign, rad or m.
        time: Time from the start to the end and back, s.
    """

    fields = ("setpoint",)

    def __init__(self, robot: RobotDescription, joint: int, amplitude: float, time: float) -> None:
        self._robot, self._joint = robot, joint
        self._amplitude, self._omega = amplitude, 2.0 * math.pi / time

    def step(self, tick: Tick) -> Sequence[float]:
        """Return the increment to the next point of the swing."""
        phase = self._omega * (tick.time + self._robot.period)
        wanted = self._robot.start[self._joint] + 0.5 * self._amplitude * (1.0 - math.cos(phase))
        dq = [0.0] * len(tick.setpoint)
        dq[self._joint] = wanted - tick.setpoint[self._joint]
        return dq


class Approach(TickProgram):
    """Program that moves all joints straight to a position, and ends there.

    Args:
        robot: The robot.
        position: Position to reach (n,), rad or m.
        speed: Share of the largest joint speeds.
    """

    fields = ("setpoint",)

    def __init__(self, robot: RobotDescription, position: Sequence[float], speed: float) -> None:
        self._position = np.array(position, dtype=np.float64)
        if len(position) != len(robot.joints):
            raise BadArgument(f"a position of {len(position)} joints; {robot.name} has {len(robot.joints)}")
        self._bound: Array = speed * robot.period * np.array([joint.velocity for joint in robot.joints])

    def step(self, tick: Tick) -> Sequence[float] | None:
        """Return the increment along the straight line; None if the position is reached."""
        left = self._position - np.array(tick.setpoint)
        if np.all(np.abs(left) < 1e-6):
            return None
        found: list[float] = (left / max(1.0, float((np.abs(left) / self._bound).max()))).tolist()
        return found


def swing(context: ProgramContext, *, joint: int = 0, amplitude: float = 0.5, time: float = 2.0) -> Swing:
    """Return a program that swings one joint between its start and an end.

    Args:
        context: Context of the trial.
        joint: Index of the joint.
        amplitude: Distance A of the end from the start, with sign, rad or m.
        time: Time from the start to the end and back, s.
    """
    robot = _robot(context)
    if not 0 <= joint < len(robot.start) or not time > 0.0:
        raise BadArgument(
            f"joint {joint}, time {time:g} s; expected 0 to {len(robot.start) - 1}, and time > 0"
        )
    return Swing(robot, joint, amplitude, time)


def approach(context: ProgramContext, *, position: Sequence[float], speed: float = 0.5) -> Approach:
    """Return a program that moves straight to a position in joint space, and ends there.

    Args:
        context: Context of the trial.
        position: Position to reach, rad or m by joint.
        speed: Share of the largest joint speeds, up to 1.
    """
    if not 0.0 < speed <= 1.0:
        raise BadArgument(f"speed {speed:g}; expected a share above 0, up to 1")
    return Approach(_robot(context), position, speed)


def _robot(context: ProgramContext) -> RobotDescription:
    for robot in context.cell.description.robots:
        if robot.name == context.robot:
            return robot
    raise BadArgument(f"robot {context.robot!r} is not in the cell; expected the key robot at the controller")
