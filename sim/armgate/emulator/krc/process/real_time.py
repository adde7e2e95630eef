"""Real-time run of a virtual KRC: cycles by the wall clock, datagrams on a UDP socket."""

import asyncio
from collections.abc import Callable, Mapping
from time import monotonic_ns

from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.log import EventLog
from armgate.emulator.krc.process.network import NS, Channel
from armgate.emulator.krc.process.udp_socket import Datagram, Peer, UdpSocket
from armgate.emulator.krc.rsi.reply_filter import Arrival
from armgate.emulator.timer import Timer

_SLACK = 4
"""Part of a cycle (1/4) by which a telegram may be late before all later ones are shifted."""


class RealTimeRunner:
    """Runner of a controller, cycle by cycle.

    A real KRC has a steady clock. If this process is late by more than a quarter of a cycle, its clock slips
    instead of catching up, so the PC always has at least three quarters of a cycle to reply.

    Args:
        controller: The KRC.
        cycle: Time of a cycle, s.
        peer: Address of the PC.
        to_pc: Network for telegrams.
        to_krc: Network for replies.
        log: Log of the KRC.
        trace: Called with the KRC's status after each cycle in which it sends.
        port: Port of all runs; 0: another one for each run.
        now: Monotonic clock, ns.
    """

    def __init__(
        self,
        controller: Controller,
        cycle: float,
        peer: Peer,
        *,
        to_pc: Channel[bytes],
        to_krc: Channel[Datagram],
        log: EventLog,
        trace: Callable[[Mapping[str, object]], None] | None = None,
        port: int = 0,
        now: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._controller, self._peer, self._log, self._now = controller, peer, log, now
        self._period = round(NS * cycle)
        self._to_pc, self._to_krc, self._trace = to_pc, to_krc, trace
        self._fixed_port, self._socket = port, UdpSocket(peer, port)
        self._cycle_timer, self._send_timer = Timer(), Timer()
        self._deadline = self._sent = 0
        self.slips = 0
        """Number of slips of the clock."""
        self.unsent = 0
        """Number of telegrams that the network did not accept."""

    @property
    def port(self) -> int:
        """Port from which telegrams are sent."""
        return self._socket.port

    def start(self) -> None:
        """Start with the first cycle now."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._cycle_timer.fileno(), self._on_cycle)
        loop.add_reader(self._send_timer.fileno(), self._send_due)
        self._deadline = self._sent = self._now()
        self._cycle_timer.arm(self._deadline)

    def reopen(self) -> None:
        """Open another socket, as each RSI_ON does."""
        self._socket.close()
        self._socket = UdpSocket(self._peer, self._fixed_port)

    def close(self) -> None:
        """Stop sending, and close timers and socket."""
        loop = asyncio.get_running_loop()
        for timer in (self._cycle_timer, self._send_timer):
            loop.remove_reader(timer.fileno())
            timer.close()
        self._socket.close()

    def _on_cycle(self) -> None:
        if not self._cycle_timer.expired():
            return
        telegram = self._controller.cycle(self._arrivals())
        self._sent = self._now()
        if telegram is not None:
            self._to_pc.put(telegram, self._sent)
        self._send_due()
        if telegram is not None and self._trace is not None:
            self._trace(self._controller.status())
        self._arm()

    def _arm(self) -> None:
        slipped = (self._sent - self._deadline) * _SLACK > self._period
        self.slips += slipped
        self._deadline = (self._sent if slipped else self._deadline) + self._period
        self._cycle_timer.arm(self._deadline)

    def _arrivals(self) -> list[Arrival]:
        for datagram, age in self._socket.receive():
            self._to_krc.put(datagram, self._now() - age)
        return [
            Arrival(datagram.data, (due - self._sent) / NS, datagram.stranger)
            for due, datagram in self._to_krc.get(self._now())
        ]

    def _send_due(self) -> None:
        """Send the telegrams that the simulated network has delivered, and wait for the next one."""
        self._send_timer.expired()
        for _, telegram in self._to_pc.get(self._now()):
            try:
                self._socket.send(telegram)
            except OSError as error:
                self.unsent += 1
                self._log.repeated("unsent", self.unsent, f"the network does not accept telegrams: {error}")
        due = self._to_pc.next_due
        if due is not None:
            self._send_timer.arm(due)
