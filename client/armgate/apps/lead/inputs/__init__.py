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
from armgate.apps.lead.motions import MotionRequest, RobotState
from armgate.client import RobotDescription

GROUP = "armgate.inputs"
Mode = Literal["joint", "tool"]
_LEAST = 1.0 / 16.0


class Input(Protocol):
    """One source of wishes."""

    def request(self, state: RobotState) -> MotionRequest:
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
        report: Prints a line for people.
    """

    robot: RobotDescription
    mode: Mode
    report: Callable[[str], object]


class SpeedShare:
    """A share of the leader's largest speeds, halved and doubled.

    Attributes:
        share: Above 0, at most 1.

    Args:
        report: Prints a line for people.
    """

    def __init__(self, report: Callable[[str], object]) -> None:
        self.share = 0.5
        self._report = report

    def faster(self) -> None:
        """Double it, up to all."""
        self._set(min(1.0, 2.0 * self.share))

    def slower(self) -> None:
        """Halve it."""
        self._set(max(_LEAST, 0.5 * self.share))

    def _set(self, share: float) -> None:
        self.share = share
        self._report(f"{share:.0%} of the speed")


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
