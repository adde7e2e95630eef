"""The RSI link on a UDP socket."""

import asyncio
import socket
import time
from collections.abc import Callable
from contextlib import suppress

from armgate.events import Plan, PlanAnswer, Rebase
from armgate.links.link import Emit
from armgate.links.rsi.link import RsiLink
from armgate.links.rsi.setup import Setup
from armgate.links.rsi.telegram import LIMIT
from armgate.links.rsi.udp import bound


class RsiUdpLink:
    """Listens for a KRC; a ``SelfClockedLink``.

    It reads its socket itself: asyncio's own endpoint makes room for 256 KiB at every datagram, which costs
    as much as all else that a reply takes.

    Args:
        setup: Its robot and KRC.
        start: The daemon's start id.
        note: Told in plain words, once each, what is wrong with what comes in.
        now: The clock of ticks, s.
    """

    def __init__(
        self,
        setup: Setup,
        start: str,
        note: Callable[[str], None] = lambda text: None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.core = RsiLink(setup, start, note)
        self._listen = setup.listen
        self._now = now
        self._emit: Emit
        self._socket: socket.socket | None = None
        self._watch: asyncio.TimerHandle | None = None

    @property
    def robot(self) -> str:
        """The robot's name."""
        return self.core.robot

    @property
    def remaining(self) -> int:
        """How many increments are still to be played if nothing else comes; 0 at rest."""
        return self.core.remaining

    @property
    def port(self) -> int:
        """On which it listens.

        Raises:
            RuntimeError: It does not.
        """
        if self._socket is None:
            raise RuntimeError("the link is not open")
        return int(self._socket.getsockname()[1])

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        return self.core.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; a link that is lost or has faulted is re-armed."""
        self.core.rebase(rebase)
        self._arm()

    async def open(self, emit: Emit) -> None:
        """Start to listen; every tick is emitted after the KRC has been answered.

        Raises:
            OSError: The address cannot be listened on.
        """
        self._emit = emit
        self._socket = bound(self._listen)
        asyncio.get_running_loop().add_reader(self._socket, self._hear, self._socket)

    def close(self) -> None:
        """End: the KRC is not answered any more."""
        if self._watch is not None:
            self._watch.cancel()
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
        self._watch = self._socket = None

    def _hear(self, own: socket.socket) -> None:
        """A datagram came: answer at once, then tell."""
        try:
            data, source = own.recvfrom(LIMIT + 1)
        except OSError:  # nothing there, or the news that an earlier reply found nobody
            return
        answer = self.core.datagram(data, source, self._now())
        if answer.reply is not None:
            with suppress(OSError):  # the network does not take it: to the KRC it is lost
                own.sendto(answer.reply, source)
        for event in answer.events:
            self._emit(event)
        if self._watch is None:
            self._arm()

    def _arm(self) -> None:
        """Look again when the link may be lost; a telegram in between only moves the deadline."""
        deadline = self.core.next_deadline()
        if self._watch is not None:
            self._watch.cancel()
        self._watch = None
        if deadline is not None and self._socket is not None:
            delay = max(deadline - self._now(), 0.0)
            self._watch = asyncio.get_running_loop().call_later(delay, self._look)

    def _look(self) -> None:
        self._watch = None
        for event in self.core.poll(self._now()):
            self._emit(event)
        self._arm()
