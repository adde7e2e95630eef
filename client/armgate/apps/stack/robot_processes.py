"""Processes of robots outside of the daemon: a robot server, and virtual KRCs in place of real ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.apps.errors import UsageError
from armgate.apps.stack.run_folder import socket_in
from armgate.cell.config import CellConfig, RobotConfig
from armgate.cell.config.link import AxisGroup, RsiLinkConfig

SERVER = "robots"
"""Name of the robot server among the children of a run."""
KRC = "krc-"
"""Start of the names of virtual KRCs among the children of a run."""


@dataclass(frozen=True)
class RobotProcesses:
    """Robot server and virtual KRCs of a run.

    Attributes:
        socket: Socket of the robot server.
        krcs: Arguments of ``armgate`` that start each virtual KRC, by the child's name.
    """

    socket: Path
    krcs: Mapping[str, Sequence[str]]

    def server(self, configs: Sequence[Path]) -> list[str]:
        """Return the arguments of ``armgate`` that start the robot server."""
        return ["robot-server", *map(str, configs), "--socket", str(self.socket)]


def robots_of(cell: CellConfig, configs: Sequence[Path], run: Path) -> RobotProcesses | None:
    """Return the processes that a cell needs besides the daemon; None if the daemon emulates all robots.

    Args:
        cell: The configuration.
        configs: Files of the configuration.
        run: The run's folder. Its ``logs`` hold the robot server's socket and, as ``krc-ROBOT.csv``, the
            setpoints that the drives of each virtual KRC received.

    Raises:
        UsageError: A robot is real; this command must not move it.
    """
    krcs = {}
    for name, robot in cell.robots.items():
        if isinstance(robot.link, RsiLinkConfig):
            child = f"{KRC}{name}"
            trace = ["--trace", str(run / "logs" / f"{child}.csv")]
            krcs[child] = _krc(cell, name, robot, robot.link, configs) + trace
    return RobotProcesses(socket_in(run), krcs) if krcs else None


def _krc(
    cell: CellConfig, name: str, robot: RobotConfig, link: RsiLinkConfig, configs: Sequence[Path]
) -> list[str]:
    if link.virtual is None or link.listen is None:
        raise UsageError(
            f"robot {name} has a real KRC; this command moves only robots whose link names a virtual KRC "
            "(virtual) and the address that answers it (listen)"
        )
    ethernet = cell.file(("robots", name, "link", "ethernet"), link.ethernet)
    command = ["krc", "--profile", link.virtual, "--config", str(ethernet), "--robot", name]
    command += [word for config in configs for word in ("--cell", str(config))]
    command += ["--to", link.listen, "--cycle", f"{1000 * robot.period:g}", "--mode", link.mode]
    command += ["--precision", str(link.precision), "--timeout", str(link.timeout)]
    if link.axiscorr is not None:
        # AXISCORR clips corrections below this limit, so AXISCORRMON cannot trip.
        command += ["--axiscorr", _listed(link.axiscorr, 0.0), "--axiscorrmon", _listed(link.axiscorr, 1.0)]
    return command


def _listed(limits: Mapping[AxisGroup, float], more: float) -> str:
    return ",".join(f"{axis}={limit + more:g}" for axis, limit in limits.items())
