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
    Probe,
    RawClient,
    SdkClient,
    Setting,
)
from tools.simulate.clients.hostile import Crowd, Rival, Vandal
from tools.simulate.daemon_checks import DaemonChecks
from tools.simulate.faults import Fault, Faults, schedule_of
from tools.simulate.findings import Findings
from tools.simulate.machine import interposed
from tools.simulate.machine.disk import Disk
from tools.simulate.machine.machine import Machine, Process
from tools.simulate.machine.network import Conditions, Network
from tools.simulate.machine.sockets import SimulatedSocket, SimulatedTimer
from tools.simulate.recording_checks import RecordingChecks
from tools.simulate.stack import ROBOTS, Life, Stack, WatchedRobots, largest_steps

_S = 1_000_000_000
_CALM = 1.2
"""Time after the last fault in which everything recovers, s."""

_PROBE = 8.0
"""Time within which every robot can be commanded again, s."""

_ACCEPTED = 3
_STEPS = 20
"""Ticks of a lock-step that show that it continues."""

_LEAVE = 1.5
"""Time after which no data of disconnected clients may remain, s."""

_EXPIRY = 0.6
"""Time after which a lease must have expired, beyond its time to live, s."""

_UNREACHABLE = 40.0
"""Time within which the daemon notices that hosts have vanished, s."""

_SLOW = 0.05
"""Period above which a simulation waits that long, s."""

_END = 12.0
"""Time within which the daemon ends, s."""

_REPLAYED = 5
"""Every so many seeds, recordings are replayed."""

_CROWDED, _RIVALLED = 0.15, 0.3
"""Shares of the simulations with a crowd of connections, and with a second daemon at the robot server."""

_PACE = 0.02
"""Period above which clients act more rarely, s."""

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
        self._network.conditions = Conditions(
            partial_write=choose.choice((0.0, 0.05)),
            partial_read=choose.choice((0.0, 0.05)),
            send_buffer=choose.choice((4, 32, 128)) * 1024,
            window=choose.choice((4, 16, 64)) * 1024,
        )
        self._disk = Disk(self._machine, self._random("disk"))
        self._findings = Findings(self._machine.trace)
        pace = max(1.0, min(self._variant.periods) / _PACE)
        self._setting = Setting(
            self._findings,
            lockstep,
            largest_steps(self._cell),
            cell=self._cell.hash,
            robots=ROBOTS,
            robots_held=lambda: self._stack.robots_held,
            pace=pace,
        )
        self._daemons = DaemonChecks(self._findings, self._cell.config.server, len(self._cell.robots))
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
        names = ("left", "right", "op", "eye", "sdk0", "sdk1", "hand0", "hand1", "probe")
        self._setting.tokens = {name: f"secret of {name}" for name in names}
        roles: dict[str, Role] = {"op": "operator", "probe": "operator", "eye": "observer"}
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
        kinds |= {"crowd": Crowd} if choose.random() < _CROWDED else {}
        kinds |= {"rival": Rival} if self._mode == "server" and choose.random() < _RIVALLED else {}
        self._kinds = kinds
        self._clients: dict[str, Process] = {}
        self._starts = 0
        return list(kinds)

    def start_client(self, name: str) -> None:
        """Start a client, unless it runs."""
        if name in self._clients and self._clients[name].alive:
            return
        number, self._starts = list(self._kinds).index(name), self._starts + 1
        before = self._clients.get(name)
        host = f"10.0.0.{number + 1}" if before is None else before.host
        if host in self._faults.vanished:
            host = f"10.0.{self._starts}.{number + 1}"
        process = self._clients[name] = self._machine.process(name, host)
        client: RawClient | SdkClient | Crowd | Rival = self._kinds[name](
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
            gc.collect()
            if collecting:
                gc.enable()
        self._check_recordings()
        return self._result()

    def _check_recordings(self) -> None:
        """Check the recordings, and replay some of them."""
        checks = RecordingChecks(self._cell, self._disk, self._findings)
        for life in self._stack.lives:
            if not self._over():
                checks.check(life, replay=self._seed % _REPLAYED == 0)

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
        if not self._over():
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
        """Check the running daemon from inside."""
        life = self._stack.life
        if life is None:
            return
        self._daemons.running(life)
        if self._mode != "lockstep":
            self._check_expiry(life)

    def _check_expiry(self, life: Life) -> None:
        """Check that no client holds a robot that has sent nothing for longer than the time to live."""
        late = self._machine.now - round((self._variant.ttl + _EXPIRY) * _S)
        if life.process.stalled_until > late:
            return
        for robot, (fence, wire) in self._setting.holders.items():
            held = life.checks.fences.get(robot) == fence and wire.daemon is life.process
            if held and wire.silent_since < late:
                self._findings.report("leases expire", f"{robot} fence {fence}: {wire.silent_since} ns")

    def _calm(self) -> None:
        """End all faults; then the stack must work, forget clients that leave, and end on a signal."""
        self._faults.heal()
        self._setting.calm = True
        self._run_for(_CALM)
        if self._mode == "lockstep":
            self._probe_steps()
        else:
            self._probe()
        self._setting.over = True
        self._run_for(_UNREACHABLE if self._vanished else _LEAVE)
        life = self._stack.life
        if life is None:
            self._findings.report("the daemon runs until it is ended", "there is none in the end")
            return
        if self._mode != "lockstep" and (self._vanished or not self._faults.vanished):
            self._daemons.idle(life)
        if self._over():
            return
        self._stack.end_daemon(kill=False)
        self._run_for(_END, lambda: self._stack.life is None)
        if self._stack.life is not None and not self._over():
            self._findings.report("the daemon ends", f"not within {_END:g} s")

    @property
    def _vanished(self) -> bool:
        """True if hosts have vanished, and ticks are slow enough to wait until the daemon notices."""
        return bool(self._faults.vanished) and min(self._variant.periods) > _SLOW

    def _probe(self) -> None:
        """Check that every robot can be reset, acquired and commanded."""
        process = self._machine.process("probe", "10.0.0.99")
        probe = Probe("probe", self._setting, self._random("probe"))
        with self._machine.inside(process):
            main = probe.run()
        process.start(main)
        self._run_for(_PROBE, lambda: min(probe.accepted.values()) >= _ACCEPTED)
        if min(probe.accepted.values()) < _ACCEPTED and not self._over():
            self._findings.report("the stack works after faults", f"{probe.accepted}")

    def _probe_steps(self) -> None:
        """Check that the lock-step continues; a participant whose host vanished is dropped first."""
        enough = self._stack.ticks + _STEPS
        self._run_for(_UNREACHABLE, lambda: self._stack.ticks >= enough)
        if self._stack.ticks < enough and not self._over():
            self._findings.report("the lock-step goes on", f"{self._stack.ticks} ticks; expected {enough}")

    def _run_for(self, seconds: float, done: Callable[[], bool] = lambda: False) -> None:
        enough = self._stack.ticks + max(200, self._steps // 4) if self._mode == "lockstep" else 1 << 62
        until = self._machine.now + round(seconds * _S)
        self._machine.run(until, lambda: self._over() or done() or self._stack.ticks >= enough)

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
