"""Time by the robots themselves: they tick in the robot server, and what they do arrives here."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from armgate.cell.cell import Cell
from armgate.daemon.core.core import Core
from armgate.daemon.core.peer import Peer
from armgate.links.robot_server.client import RemoteEvent, RemoteLink, RobotServerClient
from armgate.protocol import messages as m

_LOOK = 0.1
"""Time between two looks at what has to end without a tick, s: leases, and the daemon itself."""


class RobotDrivenPace:
    """The pace of robots behind the robot server.

    Args:
        path: The robot server's socket.
        cell: The cell.
        start: The daemon's start id.
        on_event: Called with each event.
        on_idle: Called now and then with daemon time, whatever the robots do.
    """

    lockstep = False
    failed = False
    """Whether the run is a failed one, though the daemon works; never."""

    def __init__(
        self,
        path: Path,
        cell: Cell,
        start: str,
        on_event: Callable[[RemoteEvent], None],
        on_idle: Callable[[float], None],
    ) -> None:
        names = [robot.name for robot in cell.robots]
        self._client = RobotServerClient(path, cell.hash, names, start)
        self._on_event = on_event
        self._on_idle = on_idle
        self._timer: asyncio.TimerHandle | None = None
        self._core: Core

    @property
    def links(self) -> list[RemoteLink]:
        """The robots, in the order of the configuration."""
        return self._client.links

    def now(self) -> float:
        """Daemon time, s."""
        return self._client.time

    def session_id(self, name: str, number: int) -> str:
        """Id of the session with this name and number of connection."""
        return f"s{number}"

    async def open(self) -> None:
        """Get the robots; what they say waits for the start.

        Raises:
            SocketError: There is no robot server, or it refuses.
        """
        await self._client.open()

    def start(self, core: Core) -> None:
        """Begin: hear what the robots, who tick already, have said and say."""
        self._core = core
        self._client.start(self._on_event)
        self._look()

    def let_rest(self, judging: bool) -> None:
        """Go on until the robots rest: they do so anyway."""

    def close(self) -> None:
        """Nothing further comes."""
        if self._timer is not None:
            self._timer.cancel()
        self._client.close()

    def join(self, peer: Peer) -> None:
        """A session said hello."""
        self._core.join(peer)

    def handle(self, peer: Peer, message: m.Message) -> None:
        """A client said something: it counts at once."""
        self._core.handle(peer, message)

    def leave(self, peer: Peer) -> None:
        """A session is gone."""
        self._core.leave(peer)

    def _look(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(_LOOK, self._look)
        self._on_idle(self.now())
