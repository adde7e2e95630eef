"""Processes of robots outside of the daemon: a robot server, and virtual robots in place of real ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.apps.errors import UsageError
from armgate.apps.stack.run_folder import socket_in
from armgate.cell.config import CellConfig
from armgate.cell.config.link_kinds import load_kind

SERVER = "robots"
"""Name of the robot server among the children of a run."""


@dataclass(frozen=True)
class RobotProcesses:
    """Robot server and virtual robots of a run.

    Attributes:
        socket: Socket of the robot server.
        virtual: Arguments of ``armgate`` that start each virtual robot, by the child's name.
    """

    socket: Path
    virtual: Mapping[str, Sequence[str]]

    def server(self, configs: Sequence[Path]) -> list[str]:
        """Return the arguments of ``armgate`` that start the robot server."""
        return ["robot-server", *map(str, configs), "--socket", str(self.socket)]


def robots_of(cell: CellConfig, configs: Sequence[Path], run: Path) -> RobotProcesses | None:
    """Return the processes that a cell needs besides the daemon; None if the daemon emulates all robots.

    Args:
        cell: The configuration.
        configs: Files of the configuration.
        run: The run's folder. Its ``logs`` hold the robot server's socket and the traces of virtual robots.

    Raises:
        UsageError: A robot is real; this command must not move it.
    """
    kinds = {name: load_kind(robot.link.kind) for name, robot in cell.robots.items()}
    if not any(kind.self_clocked for kind in kinds.values()):
        return None
    virtual = {}
    for name, kind in kinds.items():
        if not kind.self_clocked:
            continue
        link = cell.robots[name].link
        process = kind.virtual(link, cell, name, configs, run / "logs")
        if process is None:
            raise UsageError(
                f"robot {name} is a real robot (its link is of kind {link.kind}); this command moves "
                "a robot only if its link names a virtual robot that replaces it"
            )
        virtual[process.name] = process.command
    return RobotProcesses(socket_in(run), virtual)
