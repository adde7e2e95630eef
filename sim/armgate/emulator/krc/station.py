"""A virtual KRC by the wall clock, on a UDP socket."""

import asyncio
from collections.abc import Callable, Mapping
from time import monotonic_ns

from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.inbox import Arrival
from armgate.emulator.krc.network import NS, Channel
from armgate.emulator.krc.notes import Notes
from armgate.emulator.krc.port import Datagram, Peer, Port
from armgate.emulator.timer import Timer

_SLACK = 4
"""A telegram that is late by more than this part of a cycle shifts all later ones."""


class Station:
    """Runs a controller cycle by cycle.

    A real KRC has a steady clock. Where this process comes late by more than a quarter of a cycle, its clock
    slips instead of making up for it: the PC always has at least three quarters of a cycle to answer.

    Args:
        controller: The KRC.
        cycle: From one cycle to the next, s.
        peer: Where the PC is.
        to_pc: What happens to telegrams on their way.
        to_krc: What happens to replies on theirs.
        notes: The KRC's log.
        trace: Told the KRC's status after each cycle in which it sends.
        port: From which each run sends; 0: from another one each.
        now: The monotonic clock, ns.
    """

    def __init__(
        self,
        controller: Controller,
        cycle: float,
        peer: Peer,
        *,
        to_pc: Channel[bytes],
        to_krc: Channel[Datagram],
        notes: Notes,
        trace: Callable[[Mapping[str, object]], None] | None = None,
        port: int = 0,
        now: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._controller, self._peer, self._notes, self._now = controller, peer, notes, now
        self._period = round(NS * cycle)
        self._to_pc, self._to_krc, self._trace = to_pc, to_krc, trace
        self._number, self._port = port, Port(peer, port)
        self._clock, self._outlet = Timer(), Timer()
        self._deadline = self._sent = 0
        self.slips = 0
        """How often the clock slipped."""
        self.unsent = 0
        """How many telegrams the network did not take."""

    @property
    def port(self) -> int:
        """From which telegrams come."""
        return self._port.number

    def start(self) -> None:
        """Begin: the first cycle is now."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._clock.fileno(), self._wake)
        loop.add_reader(self._outlet.fileno(), self._let_out)
        self._deadline = self._sent = self._now()
        self._clock.arm(self._deadline)

    def reopen(self) -> None:
        """Another socket, as each RSI_ON takes one."""
        self._port.close()
        self._port = Port(self._peer, self._number)

    def close(self) -> None:
        """End: nothing is sent any more."""
        loop = asyncio.get_running_loop()
        for timer in (self._clock, self._outlet):
            loop.remove_reader(timer.fileno())
            timer.close()
        self._port.close()

    def _wake(self) -> None:
        if not self._clock.expired():
            return
        telegram = self._controller.cycle(self._arrivals())
        self._sent = self._now()
        if telegram is not None:
            self._to_pc.put(telegram, self._sent)
        self._let_out()
        if telegram is not None and self._trace is not None:
            self._trace(self._controller.status())
        self._arm()

    def _arm(self) -> None:
        slipped = (self._sent - self._deadline) * _SLACK > self._period
        self.slips += slipped
        self._deadline = (self._sent if slipped else self._deadline) + self._period
        self._clock.arm(self._deadline)

    def _arrivals(self) -> list[Arrival]:
        for datagram, age in self._port.receive():
            self._to_krc.put(datagram, self._now() - age)
        return [
            Arrival(datagram.data, (due - self._sent) / NS, datagram.stranger)
            for due, datagram in self._to_krc.get(self._now())
        ]

    def _let_out(self) -> None:
        self._outlet.expired()
        for _, telegram in self._to_pc.get(self._now()):
            try:
                self._port.send(telegram)
            except OSError as error:
                self.unsent += 1
                self._notes.often("unsent", self.unsent, f"the network does not take telegrams: {error}")
        due = self._to_pc.next_due
        if due is not None:
            self._outlet.arm(due)
