"""Links of a cell's robots in the robot server, each of the kind that its configuration names."""

import secrets
from collections.abc import Callable

from armgate.cell.cell import Cell, Robot
from armgate.cell.config.link import RsiLinkConfig
from armgate.links.emulated import EmulatedLink
from armgate.links.link import SelfClockedLink
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.rsi.setup import setup_of
from armgate.links.rsi.udp_link import RsiUdpLink
from armgate.links.wall_clocked import WallClockedLink


def needs_robot_server(cell: Cell) -> bool:
    """Return True if a robot of the cell is not emulated: then the robot server holds all of them."""
    return any(robot.config.link.kind != "emulated" for robot in cell.robots)


def host_links(
    cell: Cell, now: Callable[[], float], note: Callable[[str, str], None] = lambda robot, text: None
) -> list[HostedLink]:
    """Make the links of all robots, in the order of the configuration.

    Args:
        cell: The cell.
        now: Clock that stamps ticks, s.
        note: Called with the name of a robot and a note to the operator about what the robot sends.

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
    return WallClockedLink(emulated, robot.period, now)
