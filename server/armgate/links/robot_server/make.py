"""Berths for the robots of a cell, each with the link that its configuration names."""

import secrets
from collections.abc import Callable

from armgate.cell.cell import Cell, Robot
from armgate.cell.link_config import RsiLinkConfig
from armgate.links.emulated import EmulatedLink, SelfClockedEmulatedLink
from armgate.links.link import SelfClockedLink
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.rsi import RsiUdpLink, setup_of


def needs_robot_server(cell: Cell) -> bool:
    """Whether a robot of the cell is not emulated: then all of them are held by the robot server."""
    return any(robot.config.link.kind != "emulated" for robot in cell.robots)


def make_berths(
    cell: Cell, now: Callable[[], float], note: Callable[[str, str], None] = lambda robot, text: None
) -> list[HostedLink]:
    """Makes links and berths in the order of the configuration.

    Args:
        cell: The cell.
        now: The clock that stamps ticks, s.
        note: Told the name of a robot and, in plain words, what is wrong with what it sends.

    Raises:
        ConfigError: A robot's link cannot be made as configured; the text names file, line and key.
    """
    start = secrets.token_hex(8)
    return [
        HostedLink(_link(cell, robot, start, now, note), start, robot.q_tolerance, robot.lag_window)
        for robot in cell.robots
    ]


def _link(
    cell: Cell, robot: Robot, start: str, now: Callable[[], float], note: Callable[[str, str], None]
) -> SelfClockedLink:
    own = robot.config.link
    if isinstance(own, RsiLinkConfig):
        return RsiUdpLink(setup_of(cell, robot), start, lambda text: note(robot.name, text), now)
    emulated = EmulatedLink(robot.name, start, robot.start.tolist(), robot.period, robot.lags)
    return SelfClockedEmulatedLink(emulated, robot.period, now)
