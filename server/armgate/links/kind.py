"""Kinds of link: from the ``link`` section of a robot's configuration to a link.

A kind is one object, registered under its name as an entry point of the group ``armgate.links``. The
configuration names it (``kind: rsi``); no other kind is imported. docs/adding-a-link.md shows how to add one
outside this repository.

There are two sorts. The robot of a `LinkKind` has a clock of its own, like every real robot: its link runs
in the robot server. A `SteppedLinkKind` can be stepped by any clock: the daemon runs it itself, also in
lock-step. The robot server runs it by the wall clock if another robot of the cell needs the robot server.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from armgate.cell.config.link import LinkConfig
from armgate.cell.config.link_kinds import LinkKindError, VirtualRobot, load_kind
from armgate.links.link import SelfClockedLink, SteppedLink

if TYPE_CHECKING:  # a configuration is read without the libraries of a cell
    from armgate.cell.cell import Cell, Robot
    from armgate.cell.config import CellConfig

__all__ = [
    "LinkContext",
    "LinkKind",
    "LinkKindError",
    "LinkReport",
    "SteppedLinkKind",
    "VirtualRobot",
    "check_links",
    "check_stepped",
    "kind_of",
    "make_link",
    "make_stepped_link",
    "needs_robot_server",
]

C = TypeVar("C", bound=LinkConfig)


@dataclass(frozen=True)
class LinkReport:
    """Report of a kind about one robot, for ``armgate check``.

    Attributes:
        lines: Facts, one per line, such as the address of the robot.
        warnings: Probable mistakes that do not prevent a link, one per line.
    """

    lines: Sequence[str] = ()
    warnings: Sequence[str] = ()


@dataclass(frozen=True)
class LinkContext:
    """Context of a link in its process.

    Attributes:
        start: Start id that plans carry.
        now: Clock that stamps ticks, s.
        note: Called with each note to the operator about what the robot sends.
    """

    start: str
    now: Callable[[], float]
    note: Callable[[str], None]


class LinkKind(ABC, Generic[C]):
    """Kind of link whose robot has a clock of its own.

    Attributes:
        config: Model of the robot's ``link`` section.
        self_clocked: True if the link must run in the robot server.
    """

    config: type[C]
    self_clocked = True

    def check(self, own: C, cell: "Cell", robot: "Robot") -> LinkReport:
        """Check a robot's configuration, without connecting to the robot.

        Args:
            own: The robot's ``link`` section.
            cell: The cell.
            robot: The robot.

        Raises:
            ConfigError: The link cannot be made; ``cell.config.error`` adds file, line and key.
        """
        return LinkReport()

    @abstractmethod
    def make(self, own: C, cell: "Cell", robot: "Robot", context: LinkContext) -> SelfClockedLink:
        """Return the link of a robot; it connects when it is opened.

        Args:
            own: The robot's ``link`` section.
            cell: The cell.
            robot: The robot.
            context: Start id, clock and notes.

        Raises:
            ConfigError: The link cannot be made.
        """

    def virtual(
        self, own: C, config: "CellConfig", robot: str, files: Sequence[Path], logs: Path
    ) -> VirtualRobot | None:
        """Return the process that replaces the robot when a command starts the whole cell.

        Args:
            own: The robot's ``link`` section.
            config: The configuration.
            robot: Name of the robot.
            files: Files of the configuration.
            logs: Folder for logs of the run.

        Returns:
            None if there is none: such a command then refuses to move the robot, which may be a real one.
        """
        return None


class SteppedLinkKind(LinkKind[C]):
    """Kind of link whose robot can be stepped by any clock."""

    self_clocked = False

    @abstractmethod
    def make_stepped(self, own: C, cell: "Cell", robot: "Robot", start: str) -> SteppedLink:
        """Return the link of a robot that another clock steps.

        Args:
            own: The robot's ``link`` section.
            cell: The cell.
            robot: The robot.
            start: Start id that plans carry.
        """

    def make(self, own: C, cell: "Cell", robot: "Robot", context: LinkContext) -> SelfClockedLink:
        """Return the link with a wall clock of the robot's period."""
        from armgate.links.own_clock import OwnClockLink  # noqa: PLC0415  (see above)

        stepped = self.make_stepped(own, cell, robot, context.start)
        return OwnClockLink(stepped, robot.period, context.now)


def kind_of(robot: "Robot") -> LinkKind[Any]:
    """Return the kind of a robot's link.

    Raises:
        LinkKindError: Its entry point is not a `LinkKind`.
    """
    name = robot.config.link.kind
    found = load_kind(name)
    if not isinstance(found, LinkKind):
        raise LinkKindError(f"kind {name!r} is a {type(found).__name__}; expected a LinkKind")
    return found


def needs_robot_server(cell: "Cell") -> bool:
    """Return True if a robot has a clock of its own: then the robot server runs the links of all robots."""
    return any(kind_of(robot).self_clocked for robot in cell.robots)


def check_links(cell: "Cell") -> dict[str, LinkReport]:
    """Check the links of all robots; return the reports by robot.

    Raises:
        ConfigError: A link cannot be made as configured; the text names file, line and key.
    """
    return {robot.name: kind_of(robot).check(robot.config.link, cell, robot) for robot in cell.robots}


def make_link(cell: "Cell", robot: "Robot", context: LinkContext) -> SelfClockedLink:
    """Return the link of a robot, with a clock of its own.

    Raises:
        ConfigError: The link cannot be made as configured; the text names file, line and key.
    """
    return kind_of(robot).make(robot.config.link, cell, robot, context)


def make_stepped_link(cell: "Cell", robot: "Robot", start: str) -> SteppedLink:
    """Return the link of a robot for a clock of the daemon.

    Raises:
        ConfigError: The robot has a clock of its own, so that the robot server has to run its link.
    """
    return _stepped_kind(cell, robot).make_stepped(robot.config.link, cell, robot, start)


def check_stepped(cell: "Cell") -> None:
    """Check that the cell can run in virtual time.

    Raises:
        ConfigError: A robot has a clock of its own; the text names file, line and key.
    """
    for robot in cell.robots:
        _stepped_kind(cell, robot)


def _stepped_kind(cell: "Cell", robot: "Robot") -> SteppedLinkKind[Any]:
    kind = kind_of(robot)
    if not isinstance(kind, SteppedLinkKind):
        text = f"{robot.config.link.kind!r} has a clock of its own; a run in virtual time expects 'emulated'"
        raise cell.config.error(("robots", robot.name, "link", "kind"), text)
    return kind
