"""Actions: numbers of an agent become increments of robots."""

from collections.abc import Sequence
from typing import Literal, assert_never

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from armgate.cell.cell import Robot
from armgate.control.bounds import IncrementBounds
from armgate.env.errors import ActionError, EnvError

Array = NDArray[np.float64]

Units = Literal["share", "joint"]
"""``share``: −1 to 1 is the largest increment of each joint; ``joint``: rad or m per tick."""


def finite_array(value: object) -> Array | None:
    """Return real finite numbers as an array; None if the value is anything else."""
    try:
        given = np.asarray(value)
    except ValueError:  # lists of different lengths
        return None
    if given.dtype.kind not in "biuf" or np.ma.is_masked(value):
        return None
    numbers = given.astype(np.float64)
    return numbers if np.isfinite(numbers).all() else None


class Actions:
    """Conversion of actions; the joints of all robots of the agent follow each other.

    Args:
        robots: Robots of the agent.
        units: Units of an action.
        within: True to adjust each increment to the robot's bounds of speed, acceleration and position, as a
            well-behaved controller does. The gate then limits or refuses only because of other bodies.

    Attributes:
        space: Space of the actions.

    Raises:
        EnvError: The units are unknown.
    """

    def __init__(self, robots: Sequence[Robot], units: Units, within: bool) -> None:
        self.bounds = {robot.name: IncrementBounds.of(robot) for robot in robots}
        self._within = within
        largest = np.concatenate([robot.velocity * robot.period for robot in robots])
        match units:
            case "share":
                self._unit, high = largest, np.ones_like(largest)
            case "joint":
                self._unit, high = np.ones_like(largest), largest
            case _:
                if units not in ("share", "joint"):
                    raise EnvError(f"units {units!r}; expected 'share' or 'joint'")
                assert_never(units)
        ends = np.cumsum([len(robot.lower) for robot in robots])
        self._parts = {
            robot.name: slice(end - len(robot.lower), end) for robot, end in zip(robots, ends, strict=True)
        }
        self.space = Box(-high.astype(np.float32), high.astype(np.float32), dtype=np.float32)

    def checked(self, action: object) -> Array:
        """Return an action as an array of finite numbers (n,).

        Raises:
            ActionError: It is not.
        """
        given = finite_array(action)
        if given is None:
            raise ActionError(f"action {action!r}; expected {len(self._unit)} finite numbers")
        if given.shape != self._unit.shape:
            raise ActionError(f"action of shape {given.shape}; expected {self._unit.shape}")
        return given

    def wanted(self, action: Array) -> dict[str, Array]:
        """Return the wanted increments of each robot (n,), rad or m, for a checked action."""
        dq = action * self._unit
        return {robot: dq[part] for robot, part in self._parts.items()}

    def increment(self, robot: str, wanted: Array, last: Array, setpoint: Array) -> Array:
        """Return the increment to command (n,), after the increment ``last`` that led to the setpoint."""
        return self.bounds[robot].within(wanted, last, setpoint) if self._within else wanted
