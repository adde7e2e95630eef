"""One simulation: everything in it follows from its seed."""

import gc
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.tokens import Token, Tokens, digest
from armgate.protocol.messages import Role
from tools.simulate.cells import PARTICIPANTS, VARIANTS, cell_of
from tools.simulate.clients.behaviour import (
    Controller,
    Observer,
    Operator,
    Participant,
    RawClient,
    SdkClient,
    Setting,
    Vandal,
)
from tools.simulate.faults import Fault, Faults, schedule_of
from tools.simulate.findings import Findings
from tools.simulate.machine import interposed
from tools.simulate.machine.disk import Disk
from tools.simulate.machine.machine import Machine, Process
from tools.simulate.machine.network import Network
from tools.simulate.machine.sockets import SimulatedSocket, SimulatedTimer
from tools.simulate.stack import Stack, WatchedRobots, largest_steps

_S = 1_000_000_000
_CALM = 4.0
_END = 12.0
_CHECK_NS = 50_000_000


@dataclass
class Result:
    """Result of one simulation."""

    seed: int
    steps: int
    mode: str
    digest: str
    violations: list[str]
    schedule: list[Fault]
    trace: list[str]
    figures: dict[str, Any] = field(default_factory=dict)


class Simulation:
    """Simulation of one seed.

    Args:
        seed: The seed.
        steps: Ticks after which the simulation comes to its end.
        without: Numbers of the faults that are left out.
        keep: True to keep the whole trace.
    """

    def __init__(
        self, seed: int, steps: int, without: frozenset[int] = frozenset(), *, keep: bool = False
    ) -> None:
        choose = random.Random(f"simulation {seed}")  # noqa: S311 (no secret)
        self._seed, self._steps = seed, steps
        self._mode = choose.choice(("wall", "wall", "server", "server", "lockstep"))
        self._variant = choose.choice(VARIANTS)
        self._record = choose.random() < 0.5
        lockstep = self._mode == "lockstep"
        self._cell = cell_of(self._variant, lockstep)
        self._machine = Machine(str(seed), keep=keep)
        self._network = Network(self._machine, self._random("network"))
        self._disk = Disk(self._machine, self._random("disk"))
        self._findings = Findings(self._machine.trace)
        periods = {robot.name: robot.period for robot in self._cell.robots}
        self._setting = Setting(self._findings, lockstep, largest_steps(self._cell), periods)
        keys = self._login() if choose.random() < 0.3 else Keys()
        self._stack = Stack(
            self._machine,
            self._cell,
            self._disk,
            self._findings,
            keys=keys,
            robot_server=self._mode == "server",
            record=self._record,
        )
        seconds = steps * min(self._variant.periods) / 2
        names = list(self._behaviours(choose, lockstep))
        self._schedule = schedule_of(self._random("faults"), seconds, names, self._mode)
        self._without = without
        self._faults = Faults(self._machine, self._network, self._disk, self._stack, self._clients)

    def _random(self, name: str) -> random.Random:
        """Return a source of randomness of its own: what other parts draw does not change it."""
        return random.Random(f"{name} {self._seed}")  # noqa: S311

    def _login(self) -> Keys:
        names = ("left", "right", "op", "eye", "sdk0", "sdk1", "hand0", "hand1")
        self._setting.tokens = {name: f"secret of {name}" for name in names}
        roles: dict[str, Role] = {"op": "operator", "eye": "observer"}
        tokens: list[Any] = [
            Token(name=name, role=roles.get(name, "controller"), sha256=digest(secret))
            for name, secret in self._setting.tokens.items()
        ]
        return Keys(tokens=Tokens(tokens))

    def _behaviours(self, choose: random.Random, lockstep: bool) -> list[str]:
        kinds: dict[str, Callable[..., Any]] = {"op": Operator, "eye": Observer}
        if lockstep:
            kinds |= dict.fromkeys(PARTICIPANTS, Participant)
        else:
            kinds |= {f"hand{k}": Controller for k in range(choose.randint(0, 2))}
            kinds |= {f"sdk{k}": SdkClient for k in range(choose.randint(0, 2))}
        kinds |= {f"vandal{k}": Vandal for k in range(choose.choice((0, 0, 1, 2)))}
        self._kinds = kinds
        self._clients: dict[str, Process] = {}
        return list(kinds)

    def start_client(self, name: str) -> None:
        """Start a client, unless it runs."""
        if name in self._clients and self._clients[name].alive:
            return
        number = list(self._kinds).index(name)
        process = self._clients[name] = self._machine.process(name, f"10.0.0.{number + 1}")
        client: RawClient | SdkClient = self._kinds[name](
            name, self._setting, self._random(f"{name} {self._machine.now}")
        )
        process.on_exit = self._client_ended
        with self._machine.inside(process):
            main = client.run()
        process.start(main)

    def _client_ended(self, process: Process) -> None:
        if process.error is not None:
            self._findings.report("clients see known errors only", f"{process.name}: {process.error!r}")

    # --- running --------------------------------------------------------------------------------------------

    def run(self) -> Result:
        """Run to the end."""
        SimulatedSocket.network = self._network
        collecting = gc.isenabled()
        gc.disable()
        try:
            with (
                interposed.running(self._machine, SimulatedSocket, SimulatedTimer),
                WatchedRobots(self._stack.robots.tick),
            ):
                self._run()
        finally:
            self._machine.clear()
            if collecting:
                gc.enable()
        return self._result()

    def _run(self) -> None:
        machine, begin = self._machine, self._machine.now
        for number, fault in enumerate(self._schedule):
            if number not in self._without:
                machine.at(begin + fault.at, lambda fault=fault: self._faults.happen(fault))  # type: ignore[misc]
        self._stack.start_server()
        machine.run(machine.now + _S // 100)
        self._keep_alive()
        limit = begin + round(_S * (20.0 + 3.0 * self._steps * max(self._variant.periods)))
        machine.run(limit, lambda: self._over() or self._stack.ticks >= self._steps)
        if not self._findings.all:
            self._calm()

    def _over(self) -> bool:
        return bool(self._findings.all or self._machine.problems)

    def _keep_alive(self) -> None:
        """Start again what has ended, as a supervisor does."""
        if not self._setting.over:
            self._stack.start_server()
            self._stack.restart_daemon()
            for name in self._kinds:
                self.start_client(name)
        self._check()
        self._machine.after(_CHECK_NS, self._keep_alive)

    def _check(self) -> None:
        """Check bounds of memory."""
        life = self._stack.life
        if life is None:
            return
        inside: Any = life.daemon
        queues = inside._queues()
        config = self._cell.config.server
        checks = (
            (queues["sessions"] <= config.max_connections + 128, "sessions are bounded"),
            (queues["unread_bytes_of_one"] <= config.send_buffer + (1 << 18), "buffers are bounded"),
            (queues.get("recorder", 0) <= 514, "the queue of the recorder is bounded"),
        )
        for holds, invariant in checks:
            self._findings.check(holds, invariant, lambda: str(queues))

    def _calm(self) -> None:
        """End all faults; then the stack must work, and end on a signal."""
        self._faults.heal()
        self._setting.calm = True
        enough = self._stack.ticks + max(200, self._steps // 4)
        self._machine.run(
            self._machine.now + round(_CALM * _S), lambda: self._over() or self._stack.ticks >= enough
        )
        self._setting.over = True
        self._stack.end_daemon(kill=False)
        self._machine.run(
            self._machine.now + round(_END * _S), lambda: self._over() or self._stack.life is None
        )
        if self._stack.life is not None:
            self._findings.report("the daemon ends", "not within 12 s")

    def _result(self) -> Result:
        violations = [
            *self._findings.all,
            *(f"no exception unhandled: {text}" for text in self._machine.problems),
        ]
        figures = {"turns": self._machine.turns, "lives": len(self._stack.lives)}
        return Result(
            self._seed,
            self._stack.ticks,
            f"{self._mode} {self._variant.periods} {'recorded' if self._record else ''}",
            self._machine.digest,
            violations,
            self._schedule,
            list(self._machine.lines),
            figures,
        )
