"""Where a leader's wishes come from, as plug-ins.

    gamepad     a game controller with a deadman button
    keyboard    the terminal that the command runs in
    mailbox     whatever puts wishes into it: a page, another thread

An input is named by an entry point of the group ``armgate.inputs``; anybody's package may add some. It is
asked at each tick of the robot and answers at once: waiting would hold up the robot. Whatever it wants is
bounded in speed and acceleration before it is sent, and by the gate again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Literal, Protocol

from armgate.apps.errors import UsageError
from armgate.apps.lead.wishes import Moment, Wish
from armgate.client import RobotDescription

GROUP = "armgate.inputs"
Mode = Literal["joint", "tool"]


class Input(Protocol):
    """One source of wishes."""

    def wish(self, moment: Moment) -> Wish:
        """What is wanted at this tick; returns at once."""
        ...

    def close(self) -> None:
        """Let go of devices; called once."""
        ...


@dataclass(frozen=True)
class Setting:
    """What an input is made with.

    Attributes:
        robot: The robot that is driven, as the daemon describes it.
        mode: Whether its joints or its tool are moved first.
        tell: Prints a line for people.
    """

    robot: RobotDescription
    mode: Mode
    tell: Callable[[str], object]


Maker = Callable[[Setting], Input]


def find(name: str) -> Maker:
    """What makes the input of this name.

    Raises:
        UsageError: There is none.
    """
    known = {point.name: point for point in entry_points(group=GROUP)}
    if name not in known:
        raise UsageError(f"no input {name!r}; there are {', '.join(sorted(known))}")
    made: Maker = known[name].load()
    return made
