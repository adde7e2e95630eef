"""Pace by the clocks of the robots: they tick in the robot server, and their ticks arrive here."""

import asyncio
from collections.abc import Mapping
from pathlib import Path

from armgate.cell.cell import Cell
from armgate.daemon.pace.pace import TickReceiver
from armgate.links.robot_server.client import RemoteLink, RobotServerClient
from armgate.world.core import Core

_IDLE = 0.1
"""Time between two calls of `TickReceiver.idle`, s: leases expire even if no robot ticks."""


class RobotDrivenPace:
    """Pace of robots in the robot server; a `Pace`.

    Args:
        path: Socket of the robot server.
        cell: The cell.
        start: Start id of the daemon.
    """

    lockstep = False
    failed = False

    def __init__(self, path: Path, cell: Cell, start: str) -> None:
        names = [robot.name for robot in cell.robots]
        self._client = RobotServerClient(path, cell.hash, names, start)
        self._timer: asyncio.TimerHandle | None = None
        self._receiver: TickReceiver

    @property
    def links(self) -> list[RemoteLink]:
        """Links of the robots, in the order of the configuration."""
        return self._client.links

    def now(self) -> float:
        """Return daemon time, s."""
        return self._client.time

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session: the number of its connection."""
        return f"s{number}"

    async def open(self) -> None:
        """Connect to the robot server; its events wait for the start.

        Raises:
            SocketError: There is no robot server, or it refuses the daemon.
        """
        await self._client.open()

    def start(self, core: Core, receiver: TickReceiver) -> None:
        """Begin to report events, first the buffered ones; links report that they are ready."""
        self._receiver = receiver
        self._client.start(receiver.received)
        self._idle()

    def let_rest(self, decide: bool) -> None:
        """Do nothing: the robots wait for no client."""

    def close(self) -> None:
        """End: no further event is reported."""
        if self._timer is not None:
            self._timer.cancel()
        self._client.close()

    def warnings(self) -> Mapping[str, str]:
        """Return no warnings: the robot server reports late robots as lost."""
        return {}

    def figures(self) -> Mapping[str, float]:
        """Return no figures: the robot server logs its own."""
        return {}

    def _idle(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(_IDLE, self._idle)
        self._receiver.idle(self.now())
