"""Daemon: listens, serves, and ends with all robots at rest."""

import asyncio
import secrets
import signal
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from armgate.cell.cell import Cell
from armgate.cell.config import LockstepClockConfig
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.reloading import Reloader
from armgate.daemon.lifecycle.phase import Lifetime, Phase, PhaseEvent
from armgate.daemon.lifecycle.ticking import Ticking
from armgate.daemon.metrics.health import Health
from armgate.daemon.pace.lockstep import LockstepPace
from armgate.daemon.pace.pace import Pace
from armgate.daemon.pace.robot_driven import RobotDrivenPace
from armgate.daemon.pace.wall_clock import WallClockPace
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.supervision import Recording
from armgate.daemon.sessions.manager import SessionManager
from armgate.daemon.sessions.read_time import ReadTime
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.links.kind import make_stepped_link
from armgate.links.link import Link, SteppedLink
from armgate.links.log import Log
from armgate.links.systemd import Notifier
from armgate.protocol import DIALECTS, Dialect, ErrorCode, RemoteProtocolError
from armgate.world.core import Core
from armgate.world.gate_runner import GateRunner
from armgate.world.interfaces import Gate, Peer, RequestHandler
from armgate.world.lease_changes import LeaseTime, no_expiry
from armgate.world.welcome import Greeter


class Daemon:
    """Daemon that serves one cell until a signal ends it.

    Args:
        cell: The cell.
        gate: Makes the gate, from the cell and the start id of the daemon.
        log: Receives events.
        keys: Certificates and tokens; None: none.
        dialects: Versions of the protocol that the daemon supports.
        recorder: Records the run; None: nothing is recorded.
        robot_server: Socket of the robot server that runs the links; None: robots are emulated here.

    Attributes:
        start: Start id of the daemon; plans of another start are refused by the links.
    """

    def __init__(
        self,
        cell: Cell,
        gate: Callable[[Cell, str], Gate],
        log: Log,
        keys: Keys | None = None,
        dialects: Sequence[Dialect] = DIALECTS,
        *,
        recorder: Recorder | None = None,
        robot_server: Path | None = None,
    ) -> None:
        lockstep = isinstance(cell.config.clock, LockstepClockConfig)
        # In lock-step all messages to a client must be the same in every run, also the start id in them.
        self.start = cell.hash[:16] if lockstep else secrets.token_hex(8)
        self._cell, self._log = cell, log
        self._life = Lifetime()
        self._over = asyncio.Event()
        self._notifier = Notifier()
        self._recording = Recording(recorder, log)
        self._health = Health(cell.config.metrics.port, self._queues, log)
        self._pace, links, stepped = _make_pace(cell, self.start, log, robot_server)
        # In lock-step the clients set the pace themselves, and no tick comes late.
        scheduler = FairScheduler(share=1.0) if lockstep else FairScheduler()
        tap = None if recorder is None else recorder.tap
        runner = GateRunner(
            self._health.timed(gate(cell, self.start)), {link.robot: link for link in links}, tap
        )
        self._core = self._make_core(runner, links, scheduler)
        self._ticking = self._make_ticking(stepped)
        greeter = Greeter(cell.config, self.start, lockstep, dialects)
        self._sessions = SessionManager(
            cell.config.server,
            keys or Keys(),
            self._core,
            self._pace,
            self._request_handler(),
            scheduler=scheduler,
            greeter=greeter,
            log=log,
            failed=self.failed,
        )

    def _make_core(self, runner: GateRunner, links: Sequence[Link], scheduler: FairScheduler) -> Core:
        pace, lockstep = self._pace, self._pace.lockstep

        def defer(peer: Peer, work: Callable[[], None]) -> None:
            scheduler.run_later(peer.client.identity, False, work)

        read_time = ReadTime(pace.now, scheduler.privileged_queued, scheduler.privileged_wait)
        return Core(
            self._cell,
            runner,
            links,
            pace.now,
            self._log,
            lockstep=lockstep,
            lease_time=no_expiry if lockstep else (lambda: LeaseTime(pace.now(), read_time())),
            # In lock-step the messages to a client must not depend on how fast other clients are.
            defer=None if lockstep else defer,
            observers=[*self._health.observers, *self._recording.observers],
        )

    def _request_handler(self) -> RequestHandler:
        """Return the receiver of all requests: the core, or the lock-step in front of it."""
        if isinstance(self._pace, LockstepPace):
            self._pace.steps.attach(self._core)
            return self._pace.steps
        return self._core

    def _make_ticking(self, stepped: Sequence[SteppedLink]) -> Ticking:
        return Ticking(
            self._core,
            self._pace,
            stepped,
            self._recording,
            self._life,
            self._log,
            late=self._health.late,
            rested=self._rested,
            failed=self.failed,
        )

    async def run(self, announce: Callable[[str, int], None]) -> int:
        """Serve until a signal or a failure ends the daemon.

        Args:
            announce: Called once with host and port when clients may connect; without TCP with
                ``unix:PATH`` and 0.

        Returns:
            Exit status: 0, or 1 if something failed.

        Raises:
            OSError: The address cannot be listened on.
            RecorderError: The run cannot be recorded.
            MetricsError: The metrics cannot be served.
            SocketError: There is no robot server, or it refuses the daemon.
        """
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._unexpected)
        host, port = await self._open()
        self._handle_signals(loop)
        self._log.info("listening", host=host, port=port, start=self.start, lockstep=self._pace.lockstep)
        self._begin()
        self._sessions.start()
        announce(host, port)
        self._notifier.ready(f"listening on {host}:{port}")
        await self._over.wait()
        await self._close()
        return self._life.status

    # --- start --------------------------------------------------------------------------------------------

    async def _open(self) -> tuple[str, int]:
        """Open the robots, the port, the recording and the metrics; each may fail."""
        try:
            await self._pace.open()
            address = await self._sessions.listen()
            self._recording.begin(self._cell, self.start, self._pace.lockstep, self._pace.now)
            self._health.serve()
        except BaseException:
            self._pace.close()
            raise
        return address

    def _handle_signals(self, loop: asyncio.AbstractEventLoop) -> None:
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.end)
        sources = self._sessions.reload_sources()
        if sources is not None:
            loop.add_signal_handler(signal.SIGHUP, Reloader(sources, self._log).request)
        elif signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup sets SIG_IGN
            loop.add_signal_handler(signal.SIGHUP, self.end)

    def _begin(self) -> None:
        try:
            self._pace.start(self._core, self._ticking)
        except Exception as error:
            self.failed(error)

    # --- end ----------------------------------------------------------------------------------------------

    def end(self) -> None:
        """Stop all robots, wait until they rest, then end; end at once if this is called again."""
        if self._life.phase is not Phase.RUNNING:
            self._log.warning("end.at_once")
            self._finish(PhaseEvent.END, success=False)
            return
        self._notifier.stopping()
        self._log.info("end", robots=self._core.robots)
        self._life.advance(PhaseEvent.END)
        self._ticking.come_to_rest()
        self._sessions.refuse_hellos()
        try:
            self._core.end("the daemon is ending")
        except Exception as error:
            self.failed(error)
        else:
            self._pace.let_rest(decide=True)
        self._sessions.stop_listening()

    def failed(self, error: BaseException) -> None:
        """Process a defect: stop using the gate, let the robots play their plans to rest, then end."""
        trace = "".join(traceback.format_exception(error))
        self._log.error("failed", error=repr(error), traceback=trace)
        if not self._life.advance(PhaseEvent.FAIL):
            return
        self._life.fail()
        self._ticking.come_to_rest()
        text = "the daemon has failed; its robots come to rest: see its log"
        self._sessions.close_all(RemoteProtocolError(ErrorCode.INTERNAL, text, fatal=True).message())
        self._pace.let_rest(decide=False)
        self._sessions.stop_listening()

    def _rested(self, success: bool) -> None:
        self._finish(PhaseEvent.REST, success=success and not self._pace.failed)

    def _finish(self, event: PhaseEvent, *, success: bool) -> None:
        if not success:
            self._life.fail()
        self._life.advance(event)
        self._sessions.stop_serving()
        self._pace.close()
        self._over.set()

    async def _close(self) -> None:
        self._log.info("closing", **self._pace.figures())
        await self._sessions.close()
        self._notifier.close()
        await self._health.close()
        if not self._recording.close():
            self._life.fail()

    def _unexpected(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Process an exception of a callback of the event loop."""
        error = context.get("exception")
        if error is None or isinstance(error, OSError):  # error of a socket, not a defect
            self._log.warning("loop", text=str(context.get("message")), error=repr(error))
        else:
            self.failed(error)

    def _queues(self) -> dict[str, int]:
        """Return the lengths of queues: records, lines of the log, bytes for clients that read slowly."""
        return {**self._recording.depth, "log": self._log.depth, **self._sessions.queues()}


def _make_pace(
    cell: Cell, start: str, log: Log, robot_server: Path | None
) -> tuple[Pace, Sequence[Link], Sequence[SteppedLink]]:
    """Return the pace, the link of each robot, and the links whose robots tick in this process."""
    if robot_server is not None:
        driven = RobotDrivenPace(robot_server, cell, start)
        return driven, driven.links, ()
    periods, clock = [robot.period for robot in cell.robots], cell.config.clock
    links = [make_stepped_link(cell, robot, start) for robot in cell.robots]
    if isinstance(clock, LockstepClockConfig):
        return LockstepPace(periods, clock.participants, clock.grace, log), links, links
    return WallClockPace(periods), links, links
