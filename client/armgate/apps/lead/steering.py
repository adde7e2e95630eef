"""Steering: turns a requested motion into an increment within speed, acceleration and joint limits."""

from dataclasses import dataclass
from typing import Protocol, assert_never

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.lead.motions import JointRate, JointTarget, Motion, ToolTarget, ToolTwist
from armgate.apps.lead.shaping import Array, Bounds
from armgate.cell.placement import Placement
from armgate.control.redundancy.inverses import variably_damped_inverse

TOOL_SPEED = 0.25
"""Largest speed of the tool, m/s: the limit of ISO 10218-1 for manual operation at reduced speed."""
TOOL_TURN = 0.5
"""Largest angular speed of the tool, rad/s."""
_GAIN = 3.0
"""Rate at which the tool approaches its target, 1/s, if its speed limit is not reached."""
_SINGULAR = 0.05
"""Singular value of J, with joints scaled by their largest speeds, below which J is damped."""
_DAMPING = 0.1
"""Largest damping."""


class Tool(Protocol):
    """Task of a tool with six rows: a ``FrameTask``, which needs the cell's libraries."""

    def jacobian(self, q: Array) -> Array:
        """Return J (6, n) at q (n,)."""
        ...

    def error(self, q: Array, target: Placement) -> Array:
        """Return the displacement from q to the target (6,), m and rad."""
        ...


@dataclass(frozen=True)
class Steering:
    """Pure function of requested motion and state: equal arguments give equal increments.

    Attributes:
        bounds: Bounds of the joints.
        lower: Lower limits (n,), rad or m.
        upper: Upper limits (n,).
        share: Share of the joints' and the tool's speeds that is used, above 0, at most 1.
        tool: Task of the tool; None if only joints can be moved.
        tool_speed: Largest speed of the tool, m/s.
    """

    bounds: Bounds
    lower: Array
    upper: Array
    share: float = 1.0
    tool: Tool | None = None
    tool_speed: float = TOOL_SPEED

    def step(self, motion: Motion | None, setpoint: Array, last: Array) -> Array:
        """Return the increment for the next tick (n,).

        Args:
            motion: Requested motion; None to come to rest.
            setpoint: Current setpoint (n,).
            last: Increment that led to it (n,).

        Raises:
            AppError: A tool motion is requested but the robot's tool cannot be moved.
        """
        # Each joint brakes independently. In a straight stop all joints would brake as long as the slowest
        # one, and others could pass their limits.
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
                # Both parts slow down together, so that the tool moves on a straight line.
                too_fast = np.linalg.norm((_GAIN * error / self._tool_speeds).reshape(2, 3), axis=1).max()
                return self._carried(_GAIN * error / max(1.0, float(too_fast)), setpoint)
            case _:
                assert_never(motion)

    def _carried(self, twist: Array, setpoint: Array) -> Array:
        """Return the increment for a tool velocity (6,), scaled as a whole to the joints' limits."""
        velocity = self.bounds.velocity
        J = self._task.jacobian(setpoint) * velocity
        dq = velocity * (variably_damped_inverse(J, _SINGULAR, _DAMPING) @ twist) * self.bounds.period
        low, high = self._room(setpoint)
        room = np.minimum(np.where(dq > 0.0, high, -low), self.share * self.bounds.increment)
        moving = np.abs(dq) > 0.0
        slowed: Array = dq * min(1.0, float(np.min(room[moving] / np.abs(dq[moving]), initial=1.0)))
        return slowed

    def _room(self, setpoint: Array) -> tuple[Array, Array]:
        """Return the smallest and largest increments from which each joint can stop before its limit."""
        low = self.bounds.reach(np.maximum(setpoint - self.lower, 0.0))
        return -low, self.bounds.reach(np.maximum(self.upper - setpoint, 0.0))

    @property
    def _task(self) -> Tool:
        if self.tool is None:
            raise AppError("the tool of this robot cannot be moved; move its joints")
        return self.tool

    @property
    def _tool_speeds(self) -> Array:
        return self.share * np.array([self.tool_speed] * 3 + [TOOL_TURN] * 3)
