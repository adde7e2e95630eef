"""Berths for the robots of a cell, each with the link that its configuration names."""

import secrets
from collections.abc import Callable

from armgate.cell.cell import Cell, Robot
from armgate.links.driven import DrivenEmulatedLink
from armgate.links.emulated import EmulatedLink
from armgate.links.link import DrivenLink
from armgate.links.remote.berth import Berth


def needs_robot_server(cell: Cell) -> bool:
    """Whether a robot of the cell is not emulated: then all of them are held by the robot server."""
    return any(robot.config.link.kind != "emulated" for robot in cell.robots)


def make_berths(cell: Cell, now: Callable[[], float]) -> list[Berth]:
    """Makes links and berths in the order of the configuration.

    Args:
        cell: The cell.
        now: The clock that stamps ticks, s.
    """
    start = secrets.token_hex(8)
    return [
        Berth(_link(robot, start, now), start, robot.q_tolerance, robot.lag_window) for robot in cell.robots
    ]


def _link(robot: Robot, start: str, now: Callable[[], float]) -> DrivenLink:
    own = robot.config.link
    emulated = EmulatedLink(robot.name, start, robot.start.tolist(), robot.period, own.lag)
    return DrivenEmulatedLink(emulated, robot.period, now)
