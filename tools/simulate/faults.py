"""Faults: a schedule that follows from the seed, and what each fault does to the simulated machine."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tools.simulate.machine.disk import Disk
from tools.simulate.machine.machine import Machine, Process
from tools.simulate.machine.network import Network, Route
from tools.simulate.stack import Stack

_S = 1_000_000_000
_DAEMON = "127.0.0.1"


@dataclass(frozen=True)
class Fault:
    """Fault at a time.

    Attributes:
        at: Time since the beginning, ns.
        kind: Kind of fault.
        target: Process that it concerns; empty for the disk and the machine.
        amount: Strength: a duration, s, or a share.
    """

    at: int
    kind: str
    target: str
    amount: float

    def __str__(self) -> str:
        return f"{self.at / _S:8.3f} s  {self.kind} {self.target} {self.amount:.3g}"


_CLIENT = ("cut", "block", "deaf", "mute", "stall", "kill", "loss", "delay", "vanish")
_DAEMON_KINDS = (
    "stall",
    "stall",
    "kill",
    "end",
    "long stall",
    "power",
    "power",
    "power",
    "clock",
    "slow",
    "slow",
)
_SERVER_KINDS = ("stall", "kill", "end", "cut", "long stall")
_DISK = ("slow disk", "full disk", "failing sync", "failing write", "failing create")
_HOUR = 3600 * _S


def schedule_of(rng: random.Random, seconds: float, clients: Sequence[str], mode: str) -> list[Fault]:
    """Return the faults of a simulation that lasts about this long.

    Args:
        rng: Source of randomness.
        seconds: Duration.
        clients: Names of the clients.
        mode: ``wall``, ``server`` or ``lockstep``.
    """
    faults = []
    for _ in range(rng.randint(0, 14)):
        at = round(rng.uniform(0.05, max(seconds, 0.1)) * _S)
        roll = rng.random()
        if roll < 0.6:
            faults.append(Fault(at, rng.choice(_CLIENT), rng.choice(list(clients)), rng.expovariate(2.0)))
        elif roll < 0.75:
            faults.append(Fault(at, rng.choice(_DAEMON_KINDS), "daemon", rng.expovariate(10.0)))
        elif roll < 0.9 and mode == "server":
            faults.append(Fault(at, rng.choice(_SERVER_KINDS), "robots", rng.expovariate(10.0)))
        else:
            faults.append(Fault(at, rng.choice(_DISK), "", rng.random()))
    return sorted(faults, key=lambda fault: fault.at)


class Faults:
    """Faults of one simulation.

    Args:
        machine: The machine.
        network: Its network.
        disk: Its disk.
        stack: Daemon and robot server.
        clients: Processes of the clients by name.

    Attributes:
        vanished: Hosts that have disappeared: their connections are not closed.
    """

    def __init__(
        self, machine: Machine, network: Network, disk: Disk, stack: Stack, clients: Mapping[str, Process]
    ) -> None:
        self._machine, self._network, self._disk = machine, network, disk
        self._stack, self._clients = stack, clients
        self._healed = False
        self.vanished: set[str] = set()

    def happen(self, fault: Fault) -> None:
        """Let a fault happen, unless all faults have ended."""
        if self._healed:
            return
        self._machine.trace("fault", fault)
        if fault.target == "daemon":
            self._to_daemon(fault)
        elif fault.target == "robots":
            self._to_server(fault)
        elif fault.target:
            self._to_client(fault)
        else:
            self._to_disk(fault)

    def heal(self) -> None:
        """End all faults for good; a machine that has vanished never returns."""
        self._healed = True
        for (source, target), route in self._network.routes.items():
            if {source, target} & self.vanished:
                continue
            route.loss, route.delay_ns, route.blocked_until = 0.0, 100_000, 0
        self._disk.heal()

    def _to_daemon(self, fault: Fault) -> None:
        life = self._stack.life
        if life is None:
            return
        match fault.kind:
            case "stall":
                life.process.pause(round(fault.amount * _S))
            case "long stall":
                life.process.pause(round(10 * fault.amount * _S))
            case "kill":
                self._stack.end_daemon(kill=True)
            case "power":
                self._stack.power_failure()
            case "slow":
                life.process.slow(_S, round(min(fault.amount, 0.5) * _S / 10))
            case "clock":
                self._machine.day_ns += _HOUR if fault.at % 2 else -_HOUR
            case _:
                self._stack.end_daemon(kill=False)

    def _to_server(self, fault: Fault) -> None:
        server = self._stack.server
        if server is None or not server.alive:
            return
        match fault.kind:
            case "stall":
                server.pause(round(fault.amount * _S))
            case "long stall":
                server.pause(round(10 * fault.amount * _S))
            case "cut":
                for sock in tuple(server.sockets.values()):
                    if getattr(sock, "_in", None) is not None:
                        sock.broken()
                        sock._out.target.broken()
            case _:
                self._stack.end_server(kill=fault.kind == "kill")

    def _to_client(self, fault: Fault) -> None:
        process = self._clients.get(fault.target)
        if process is None or not process.alive:
            return
        now, ns = self._machine.now, round(fault.amount * _S)
        match fault.kind:
            case "cut":
                for sock in tuple(process.sockets.values()):
                    if getattr(sock, "_in", None) is not None:
                        sock.broken()
                        sock._out.target.broken()
            case "block" | "deaf" | "mute":
                inward, outward = fault.kind != "mute", fault.kind != "deaf"
                self._network.block(process.host, now + ns, inward=inward, outward=outward)
            case "stall":
                process.pause(ns)
            case "kill":
                process.kill()
            case "loss":
                for route in self._routes(process):
                    route.loss = min(0.3, fault.amount / 3)
            case "delay":
                for route in self._routes(process):
                    route.delay_ns = round(fault.amount * _S / 10)
            case _:
                self.vanished.add(process.host)
                self._network.block(process.host, now + 3600 * _S)
                process.kill()

    def _routes(self, process: Process) -> list[Route]:
        return [self._network.route(process.host, _DAEMON), self._network.route(_DAEMON, process.host)]

    def _to_disk(self, fault: Fault) -> None:
        if (life := self._stack.life) is not None:
            life.disk_trouble = True
        match fault.kind:
            case "slow disk":
                self._disk.slow_until = self._machine.now + 2 * _S
                self._disk.slow_ns = round(fault.amount * _S)
            case "full disk":
                self._disk.room = round(fault.amount * 30_000)
            case "failing sync":
                self._disk.sync_fails = True
            case "failing write":
                self._disk.write_fails = True
            case _:
                self._disk.create_fails = True
