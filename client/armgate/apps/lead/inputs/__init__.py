"""Inputs of manual driving, as plug-ins.

    gamepad     a game controller with a deadman button
    keyboard    the terminal that the command runs in

An input is registered by an entry point of the group ``armgate.inputs``; any package may add inputs.
``mailbox.Mailbox`` is an input, not registered, for motions from another thread, such as that of a web page.

An input is called at each tick of the robot and must return without waiting, because that would delay the
robot. The leader bounds its motions in speed and acceleration before it sends them, and the gate bounds them
again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Literal, Protocol

from armgate.apps.errors import UsageError
from armgate.apps.lead.motions import MotionRequest, RobotState
from armgate.client import RobotDescription

GROUP = "armgate.inputs"
Mode = Literal["joint", "tool"]
_LEAST = 1.0 / 16.0


class Input(Protocol):
    """Source of requested motions."""

    def request(self, state: RobotState) -> MotionRequest:
        """Return the motion requested at this tick, without waiting."""
        ...

    def close(self) -> None:
        """Release devices; called once."""
        ...


@dataclass(frozen=True)
class Setting:
    """Arguments of an input's factory.

    Attributes:
        robot: Description of the robot.
        mode: Initial mode: joints or tool.
        report: Prints a line for users.
    """

    robot: RobotDescription
    mode: Mode
    report: Callable[[str], object]


class SpeedShare:
    """Share of the leader's largest speeds, which the user halves and doubles.

    Attributes:
        share: Above 0, at most 1.

    Args:
        report: Prints a line for users.
    """

    def __init__(self, report: Callable[[str], object]) -> None:
        self.share = 0.5
        self._report = report

    def faster(self) -> None:
        """Double the share, up to 1."""
        self._set(min(1.0, 2.0 * self.share))

    def slower(self) -> None:
        """Halve the share, down to 1/16."""
        self._set(max(_LEAST, 0.5 * self.share))

    def _set(self, share: float) -> None:
        self.share = share
        self._report(f"{share:.0%} of the speed")


InputFactory = Callable[[Setting], Input]


def find(name: str) -> InputFactory:
    """Return the factory of the named input.

    Raises:
        UsageError: There is no such input.
    """
    known = {point.name: point for point in entry_points(group=GROUP)}
    if name not in known:
        raise UsageError(f"no input {name!r}; there are {', '.join(sorted(known))}")
    made: InputFactory = known[name].load()
    return made
