"""The stack in simulation: a daemon and, in some runs, a robot server, as `armgate serve` starts them."""

import signal
import socket
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, cast

from armgate import events as e
from armgate.cell.cell import Cell
from armgate.daemon.auth.keys import Keys
from armgate.daemon.lifecycle.daemon import Daemon
from armgate.daemon.recording.inline_recorder import InlineRecorder
from armgate.daemon.recording.recorder import Recorder
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.links.log import Log
from armgate.links.robot_server.hosted_link import host_links
from armgate.links.robot_server.server import RobotServer
from tools.simulate.brief import brief
from tools.simulate.findings import Findings
from tools.simulate.gate_checks import GateChecks
from tools.simulate.log import SimulatedLog
from tools.simulate.machine.disk import Disk, SimulatedWorker
from tools.simulate.machine.machine import Machine, Process
from tools.simulate.robot_checks import RobotChecks

ROBOTS = "/run/robots.sock"
_RECORDINGS = Path(tempfile.gettempdir()) / "armgate-simulation"
_BACKLOG = 4
_RESTART_NS = 400_000_000
"""Time between the end of a daemon and its next start, ns."""


@dataclass
class Life:
    """One life of a daemon: from its start to its end.

    Attributes:
        folder: Folder of its recording; None if it is not recorded.
        process: Its process.
        daemon: The daemon.
        log: Its log.
        checks: Checks of its gate.
        events: Every event of the gate with the machine's time, ns.
        asked: True if a signal to end was sent.
        disk_trouble: True if the disk was slow, full or failed, or lost its power.
        ended_at: Time of its end, ns.
    """

    folder: Path | None
    process: Process
    daemon: Daemon
    log: SimulatedLog
    checks: GateChecks
    events: list[tuple[int, e.GateEvent]] = field(default_factory=list)
    asked: bool = False
    disk_trouble: bool = False
    ended_at: int = 0


class Stack:
    """Daemon, robot server and robots of one simulation.

    Args:
        machine: The machine.
        cell: The cell.
        disk: Disk for recordings.
        findings: Receives violations.
        keys: Tokens of clients.
        robot_server: True if a robot server runs the links.
        record: True if the runs are recorded.

    Attributes:
        lives: Lives of daemons, the latest one last.
        ticks: Number of ticks that daemons have processed.
    """

    def __init__(
        self,
        machine: Machine,
        cell: Cell,
        disk: Disk,
        findings: Findings,
        *,
        keys: Keys,
        robot_server: bool,
        record: bool,
    ) -> None:
        self._machine, self._cell, self._disk, self._findings = machine, cell, disk, findings
        self._keys, self._record = keys, record
        self.has_server = robot_server
        self.lives: list[Life] = []
        self.ticks = 0
        self.server: Process | None = None
        self._server_log: SimulatedLog | None = None
        self.robots = RobotChecks(cell, findings, lambda: machine.now)
        self._ended_at = -_RESTART_NS

    @property
    def life(self) -> Life | None:
        """The running daemon; None if there is none."""
        return self.lives[-1] if self.lives and self.lives[-1].process.alive else None

    # --- the daemon -----------------------------------------------------------------------------------------

    def restart_daemon(self) -> None:
        """Start a daemon, unless one runs or ran a moment ago; full disks are cleared before."""
        if self.life is None and self._machine.now >= self._ended_at + _RESTART_NS:
            self._disk.clear()
            self._start_daemon()

    def _start_daemon(self) -> None:
        process = self._machine.process("daemon")
        number = len(self.lives)
        folder = _RECORDINGS / f"run{number}" if self._record else None
        log = SimulatedLog("daemon", self._machine.trace, lambda: self._machine.epoch_ns() / 1e9)
        made: list[GateChecks] = []
        with self._machine.inside(process):
            daemon = Daemon(
                self._cell,
                partial(self._gate, made),
                cast(Log, log),
                self._keys,
                recorder=self._recorder(folder),
                robot_server=Path(ROBOTS) if self.has_server else None,
            )
        life = Life(folder, process, daemon, log, made[0])
        self.lives.append(life)
        if not self.has_server:
            self.robots.forget()
        self.robots.abandoned = None
        process.on_exit = self._daemon_ended
        process.start(daemon.run(lambda host, port: self._machine.trace("listening", host, port)))

    def end_daemon(self, *, kill: bool) -> None:
        """End the daemon by SIGTERM or SIGKILL."""
        life = self.life
        if life is None:
            return
        if kill:
            life.process.kill()
            self._gone()
        else:
            life.asked = True
            life.process.signal(signal.SIGTERM)

    def _daemon_ended(self, process: Process) -> None:
        self._gone()
        life = self.lives[-1]
        if process.leaked:
            self._findings.report("no task leaks", f"daemon: {process.leaked}")
        error = process.error
        if error is not None:
            known = type(error).__name__ in ("SocketError", "RecorderError")
            self._findings.check(known, "no exception unhandled", lambda: f"daemon: {error!r}")
        elif not life.asked:
            self._findings.report("the daemon runs until it is ended", f"status {process.result}")
        for failure in life.log.failures:
            self._findings.report("the daemon does not fail", failure)

    def _gone(self) -> None:
        self._ended_at = self.lives[-1].ended_at = self._machine.now
        self.robots.abandoned = self._machine.now
        if not self.has_server:
            self.robots.forget()

    def _gate(self, made: list[GateChecks], cell: Cell, start: str) -> GateChecks:
        checks = GateChecks(Gate(cell, start), cell, self._findings, self._seen, self._attached)
        made.append(checks)
        return checks

    def _attached(self) -> int:
        """Return the number of connections that the robot server has accepted from daemons."""
        return self._server_log.events.get("daemon", 0) if self._server_log is not None else 0

    def _seen(self, event: e.GateEvent, outputs: list[e.GateOutput]) -> None:
        self.ticks += isinstance(event, e.Tick)
        self.lives[-1].events.append((self._machine.now, event))
        self._machine.trace("gate", *map(brief, (event, *outputs)))

    def _recorder(self, folder: Path | None) -> Recorder | None:
        if folder is None:
            return None
        if self._lockstep:
            return InlineRecorder(folder, rotate=1 << 20, limit=512, create=self._disk.create)
        worker = partial(SimulatedWorker, self._disk, self._machine)
        return Recorder(
            folder, rotate=1 << 20, limit=512, create=self._disk.create, clock=monotonic, worker=worker
        )

    @property
    def _lockstep(self) -> bool:
        return self._cell.config.clock.kind == "lockstep"

    def power_failure(self) -> None:
        """End daemon and robot server at once, and lose what was not synced."""
        for life in self.lives:  # files of daemons that were killed before are not synced either
            life.disk_trouble = True
        self.end_daemon(kill=True)
        self.end_server(kill=True)
        self._disk.power_failure()

    @property
    def robots_held(self) -> bool:
        """True if a daemon is connected to the robot server, and the link of a robot is ready."""
        life = self.life
        if life is None or not life.checks.ready:
            return False
        pipes = [
            sock for sock in life.process.sockets.values() if getattr(sock, "family", 0) == socket.AF_UNIX
        ]
        return any(sock.peer is not None and sock.usable and sock.peer.usable for sock in pipes)

    # --- the robot server -----------------------------------------------------------------------------------

    def start_server(self) -> None:
        """Start the robot server, unless it runs."""
        if not self.has_server or (self.server is not None and self.server.alive):
            return
        process = self.server = self._machine.process("robots")
        self.robots.forget()
        log = self._server_log = SimulatedLog(
            "robots", self._machine.trace, lambda: self._machine.epoch_ns() / 1e9
        )
        with self._machine.inside(process):
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            listening.bind(ROBOTS)
            listening.listen(_BACKLOG)
            listening.setblocking(False)
            links = host_links(self._cell, monotonic)
            server = RobotServer(self._cell.hash, links, log)
        process.on_exit = self._server_ended
        process.start(server.run(listening, lambda: None))

    def end_server(self, *, kill: bool) -> None:
        """End the robot server by SIGTERM or SIGKILL."""
        if self.server is not None and self.server.alive:
            if kill:
                self.server.kill()
                self.robots.forget()
            else:
                self.server.signal(signal.SIGTERM)

    def _server_ended(self, process: Process) -> None:
        self.robots.forget()
        if process.leaked:
            self._findings.report("no task leaks", f"robot server: {process.leaked}")
        if process.error is not None:
            self._findings.report("no exception unhandled", f"robot server: {process.error!r}")


class WatchedRobots:
    """Observer of the ticks of all emulated links, while it is open as a context manager."""

    def __init__(self, take: Callable[[e.Tick], None]) -> None:
        self._take = take
        self._advance: Any = EmulatedLink.advance

    def __enter__(self) -> None:
        advance, take = self._advance, self._take

        def watched(link: EmulatedLink, time: float) -> e.Tick:
            tick: e.Tick = advance(link, time)
            take(tick)
            return tick

        link_type: Any = EmulatedLink
        link_type.advance = watched

    def __exit__(self, *_: object) -> None:
        link_type: Any = EmulatedLink
        link_type.advance = self._advance


def largest_steps(cell: Cell) -> dict[str, Sequence[float]]:
    """Return the largest increment of each robot's joints, rad."""
    return {robot.name: (robot.velocity * robot.period).tolist() for robot in cell.robots}
