"""From a wish to the next increment: bounded in speed and acceleration, inside the limits, able to stop."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.lead.motions import JointRate, JointTarget, Motion, ToolTarget, ToolTwist
from armgate.apps.lead.shaping import Array, Bounds
from armgate.cell.placement import Placement
from armgate.control.redundancy.inverses import variably_damped_inverse

TOOL_SPEED = 0.25
"""Largest speed of the tool, m/s: what ISO 10218-1 allows where people may be near."""
TOOL_TURN = 0.5
"""Largest angular speed of the tool, rad/s."""
_GAIN = 3.0
"""The tool comes near its target with this rate, 1/s, where that is slower than it may be."""
_SINGULAR = 0.05
"""Smallest singular value of J, its joints counted in their largest speeds, below which it is damped …"""
_DAMPING = 0.1
"""… by at most so much."""


class Tool(Protocol):
    """The six rows of a tool's motion: a ``FrameTask``, which needs the cell's libraries."""

    def jacobian(self, q: Array) -> Array:
        """J (6, n) at q (n,)."""
        ...

    def error(self, q: Array, target: Placement) -> Array:
        """The way that is left from q to the target (6,), m and rad."""
        ...


@dataclass(frozen=True)
class Steering:
    """Pure: the same wishes at the same places give the same increments.

    Attributes:
        bounds: What the joints can do.
        lower: Lower limits (n,), rad or m.
        upper: Upper limits (n,).
        share: The largest share of the joints' and the tool's speeds that is used, above 0, at most 1.
        tool: The tool's six rows; None where wishes are for joints only.
        tool_speed: Largest speed of the tool, m/s.
    """

    bounds: Bounds
    lower: Array
    upper: Array
    share: float = 1.0
    tool: Tool | None = None
    tool_speed: float = TOOL_SPEED

    def step(self, motion: Motion | None, setpoint: Array, last: Array) -> Array:
        """The increment for the next tick (n,).

        Args:
            motion: What is wanted; None: rest.
            setpoint: The commanded position now (n,).
            last: The increment that led to it (n,).

        Raises:
            AppError: A tool is to be moved and there is none.
        """
        # At rest too each joint brakes by itself: on a straight stop the slowest would carry others too far.
        wanted = np.zeros_like(last) if motion is None else self._wanted(motion, setpoint)
        return self.bounds.towards(wanted, last)

    def _wanted(self, motion: Motion, setpoint: Array) -> Array:
        match motion:
            case JointRate(share):
                dq = np.clip(share, -1.0, 1.0) * self.share * self.bounds.increment
                return np.clip(dq, *self._room(setpoint))
            case JointTarget(q):
                target = np.clip(q, self.lower, self.upper)
                return np.clip(self.bounds.approach(target - setpoint, self.share), *self._room(setpoint))
            case ToolTwist(share):
                return self._carried(np.clip(share, -1.0, 1.0) * self._tool_speeds, setpoint)
            case ToolTarget(place):
                error = self._task.error(setpoint, place)
                # Both parts slow down together, so that the tool comes on the straight line.
                too_fast = np.linalg.norm((_GAIN * error / self._tool_speeds).reshape(2, 3), axis=1).max()
                return self._carried(_GAIN * error / max(1.0, float(too_fast)), setpoint)

    def _carried(self, twist: Array, setpoint: Array) -> Array:
        """The increment that moves the tool by ``twist`` (6,), slowed as a whole where a joint must be."""
        velocity = self.bounds.velocity
        J = self._task.jacobian(setpoint) * velocity
        dq = velocity * (variably_damped_inverse(J, _SINGULAR, _DAMPING) @ twist) * self.bounds.period
        low, high = self._room(setpoint)
        room = np.minimum(np.where(dq > 0.0, high, -low), self.share * self.bounds.increment)
        moving = np.abs(dq) > 0.0
        slowed: Array = dq * min(1.0, float(np.min(room[moving] / np.abs(dq[moving]), initial=1.0)))
        return slowed

    def _room(self, setpoint: Array) -> tuple[Array, Array]:
        """The increments of least and greatest value from which each joint can stop before its limit."""
        low = self.bounds.reach(np.maximum(setpoint - self.lower, 0.0))
        return -low, self.bounds.reach(np.maximum(self.upper - setpoint, 0.0))

    @property
    def _task(self) -> Tool:
        if self.tool is None:
            raise AppError("the tool of this robot cannot be steered; steer its joints")
        return self.tool

    @property
    def _tool_speeds(self) -> Array:
        return self.share * np.array([self.tool_speed] * 3 + [TOOL_TURN] * 3)
