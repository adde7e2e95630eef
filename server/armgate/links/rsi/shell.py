"""The RSI link on a UDP socket."""

import asyncio
import time
from collections.abc import Callable

from armgate.cell.events import Plan, PlanAnswer, Rebase
from armgate.links.link import Emit
from armgate.links.rsi.link import RsiLink
from armgate.links.rsi.setup import Setup


class RsiDrivenLink(asyncio.DatagramProtocol):
    """Listens for a KRC; a ``DrivenLink``.

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
        self._transport: asyncio.DatagramTransport | None = None
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
        if self._transport is None:
            raise RuntimeError("the link is not open")
        return int(self._transport.get_extra_info("sockname")[1])

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        return self.core.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; a link that is lost or has faulted is re-armed."""
        self.core.rebase(rebase)
        self._arm()

    def adopt(self, start: str, reason: str = "") -> None:
        """Obey another daemon (see `RsiLink.adopt`)."""
        for event in self.core.adopt(start, reason):
            self._emit(event)

    async def open(self, emit: Emit) -> None:
        """Start to listen; every tick is emitted after the KRC has been answered.

        Raises:
            OSError: The address cannot be listened on.
        """
        self._emit = emit
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=self._listen)

    def close(self) -> None:
        """End: the KRC is not answered any more."""
        if self._watch is not None:
            self._watch.cancel()
        if self._transport is not None:
            self._transport.close()
        self._watch = self._transport = None

    def datagram_received(self, data: bytes, source: tuple[str, int]) -> None:
        """A datagram came: answer at once, then tell."""
        answer = self.core.datagram(data, source, self._now())
        if answer.reply is not None and self._transport is not None:
            self._transport.sendto(answer.reply, source)
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
        if deadline is not None and self._transport is not None:
            delay = max(deadline - self._now(), 0.0)
            self._watch = asyncio.get_running_loop().call_later(delay, self._look)

    def _look(self) -> None:
        self._watch = None
        for event in self.core.poll(self._now()):
            self._emit(event)
        self._arm()
