"""Simulated network: listening addresses, routes between hosts, and the delays of what they carry."""

import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.simulate.machine.machine import Machine
    from tools.simulate.machine.sockets import SimulatedSocket

Address = tuple[str, int] | str

_RETRANSMIT_NS = 200_000_000
"""Time after which a lost segment is sent again, ns."""

_LOCAL_NS = 15_000
"""Delay within one machine, ns."""


@dataclass
class Route:
    """Connection between two hosts, in one direction.

    Attributes:
        delay_ns: Smallest delay, ns.
        jitter_ns: Mean of the additional delay, ns.
        loss: Probability that a segment is lost and sent again.
        blocked_until: Time until which nothing passes, ns.
    """

    delay_ns: int = 100_000
    jitter_ns: int = 50_000
    loss: float = 0.0
    blocked_until: int = 0


@dataclass
class Conditions:
    """Conditions under which sockets work.

    Attributes:
        partial_write: Probability that a write takes only a part of the data.
        partial_read: Probability that a read returns only a part of the data.
        send_buffer: Bytes that a socket takes before they are acknowledged.
        window: Bytes that a socket receives before they are read.
    """

    partial_write: float = 0.0
    partial_read: float = 0.0
    send_buffer: int = 128 * 1024
    window: int = 64 * 1024


@dataclass
class Network:
    """Simulated network of one machine.

    Attributes:
        machine: The machine.
        random: Source of delays and losses.
        listeners: Listening sockets by address.
        conditions: Conditions of all sockets.
        sockets: All open sockets by descriptor.
    """

    machine: "Machine"
    random: random.Random
    conditions: Conditions = field(default_factory=Conditions)
    listeners: dict[Address, "SimulatedSocket"] = field(default_factory=dict)
    sockets: dict[int, "SimulatedSocket"] = field(default_factory=dict)
    routes: dict[tuple[str, str], Route] = field(default_factory=dict)
    _numbers: int = 2
    _ports: int = 40_000

    def descriptor(self) -> int:
        """Return the number of a new descriptor."""
        self._numbers += 1
        return self._numbers

    def port(self) -> int:
        """Return a free port."""
        self._ports += 1
        return self._ports

    def route(self, source: str, target: str) -> Route:
        """Return the route between two hosts."""
        return self.routes.setdefault((source, target), Route())

    def block(self, host: str, until: int, *, inward: bool = True, outward: bool = True) -> None:
        """Let nothing pass to (``inward``) or from (``outward``) a host until a time, ns."""
        for (source, target), route in self.routes.items():
            if source != target and ((inward and host == target) or (outward and host == source)):
                route.blocked_until = max(route.blocked_until, until)

    def blocked(self, source: str, target: str) -> bool:
        """Return True if nothing passes between two hosts now."""
        now = self.machine.now
        return max(self.route(source, target).blocked_until, self.route(target, source).blocked_until) > now

    def arrival(self, source: str, target: str, local: bool) -> int:
        """Return the time at which something sent now arrives, ns."""
        now = self.machine.now
        if local:
            return now + _LOCAL_NS
        route = self.route(source, target)
        delay = route.delay_ns + int(self.random.expovariate(1.0) * route.jitter_ns)
        sent = now
        while route.loss and self.random.random() < route.loss:
            sent += _RETRANSMIT_NS
        if sent < route.blocked_until:
            sent = route.blocked_until + self.random.randint(0, _RETRANSMIT_NS)
        return sent + delay
