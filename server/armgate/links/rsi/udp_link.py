"""RSI link on a UDP socket."""

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
    """Link to a KRC; a `SelfClockedLink`.

    It reads its socket without asyncio's endpoint, which allocates 256 KiB for every datagram: that costs as
    much time as the rest of a reply.

    Args:
        setup: Robot and KRC.
        start: Start id that plans carry.
        note: Called with each note to the operator about what the KRC sends, once for each mistake.
        now: Clock of ticks, s.

    Attributes:
        core: The link without its socket.
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
        self._timer: asyncio.TimerHandle | None = None

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self.core.robot

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""
        return self.core.remaining

    @property
    def port(self) -> int:
        """Port on which it listens.

        Raises:
            RuntimeError: The link is not open.
        """
        if self._socket is None:
            raise RuntimeError("the link is not open")
        return int(self._socket.getsockname()[1])

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        return self.core.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; re-arm a link that is lost or faulted."""
        self.core.rebase(rebase)
        self._arm()

    async def open(self, emit: Emit) -> None:
        """Listen; every tick is emitted after the KRC has been answered.

        Raises:
            OSError: It is not possible to listen on the address.
        """
        self._emit = emit
        self._socket = bound(self._listen)
        asyncio.get_running_loop().add_reader(self._socket, self._receive, self._socket)

    def close(self) -> None:
        """Close the socket: the KRC is not answered any more."""
        if self._timer is not None:
            self._timer.cancel()
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
        self._timer = self._socket = None

    def _receive(self, own: socket.socket) -> None:
        """Answer a datagram at once, then emit its events."""
        try:
            data, source = own.recvfrom(LIMIT + 1)
        except OSError:  # nothing to read, or the error that an earlier reply was not delivered
            return
        response = self.core.datagram(data, source, self._now())
        if response.reply is not None:
            with suppress(OSError):  # the network did not accept it: to the KRC it is lost
                own.sendto(response.reply, source)
        for event in response.events:
            self._emit(event)
        if self._timer is None:
            self._arm()

    def _arm(self) -> None:
        """Schedule the check for the loss of the link; a telegram before it only moves the deadline."""
        deadline = self.core.next_deadline()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        if deadline is not None and self._socket is not None:
            delay = max(deadline - self._now(), 0.0)
            self._timer = asyncio.get_running_loop().call_later(delay, self._check)

    def _check(self) -> None:
        self._timer = None
        for event in self.core.poll(self._now()):
            self._emit(event)
        self._arm()
