"""The daemon's life: listens, runs, and ends with the robots at rest."""

import asyncio
import secrets
import signal
import ssl
import traceback
from collections.abc import Callable, Sequence
from enum import Enum
from importlib.metadata import version
from pathlib import Path
from time import monotonic, time
from typing import TYPE_CHECKING, Any

from armgate.cell.cell import Cell
from armgate.cell.config import LockstepClockConfig, ServerConfig
from armgate.cell.config.link import EmulatedLinkConfig
from armgate.daemon.auth.access import Access, Keys
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.reloading import Reloader, ReloadSource, warn_of_unknown_robots
from armgate.daemon.auth.tls import is_for_clients
from armgate.daemon.auth.tokens import Tokens
from armgate.daemon.core.core import Core, OnState
from armgate.daemon.core.description import BODY_EXACT, SESSIONS, STOP_REPLACES
from armgate.daemon.core.gate_runner import GateRunner, Judge
from armgate.daemon.core.peer import Peer, answer
from armgate.daemon.pace.lockstep import LockstepPace
from armgate.daemon.pace.robot_driven import RobotDrivenPace
from armgate.daemon.pace.wall_clock import WallClockPace
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.start import begin, header_of
from armgate.daemon.sessions.connection_limits import ConnectionLimits, Slot
from armgate.daemon.sessions.listener import Listener
from armgate.daemon.sessions.rate_limits import RateLimit, RateLimits, Rates
from armgate.daemon.sessions.read_time import ReadTime
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.daemon.sessions.session import Session
from armgate.emulator import Instant
from armgate.events import Tick
from armgate.links.emulated import EmulatedLink
from armgate.links.log import Log
from armgate.links.robot_server.client import RemoteEvent, RemoteLink
from armgate.links.systemd import Notifier
from armgate.protocol import (
    DIALECTS,
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    Dialect,
    ErrorCode,
    RemoteProtocolError,
)
from armgate.protocol import messages as m

if TYPE_CHECKING:
    from armgate.daemon.metrics.collector import Metrics

_SETTLE = 5.0
"""How long after the end of its plan a robot may take to be measured at rest, s of daemon time."""

_CLOSE = 2.0
"""How long sessions may take to close at the end, s."""


_TAKEN_BACK = "the token of this session was taken back or changed; come in with one that is valid"


_EXPIRED = "the token of this session has expired; come in with one that is valid"

_LOOK_FOR_EXPIRED = 1.0
"""Time between two looks for expired tokens, s."""

_NOT_FOR_CLIENTS = (
    "your certificate is not for clients: its extended key usage does not name clientAuth; "
    "have one made for a client (docs/security.md)"
)


class MetricsError(Exception):
    """The figures cannot be served there; nothing was moved."""

    exit_code = 2


class Phase(Enum):
    """Where the daemon is in its life."""

    RUNNING = "running"
    RESTING = "resting"
    """It was told to end: all robots are stopped and come to rest."""
    FAILED = "failed"
    """Something of its own failed: the gate is asked no more, the robots play their plans to rest."""
    OVER = "over"


class Daemon:
    """Serves one cell until it is told to end.

    Args:
        cell: The cell.
        gate: Makes the gate, from the cell and the daemon's start id.
        log: Where events are told.
        keys: Certificates and tokens; None: none.
        dialects: The versions of the protocol to speak, all at once.
        recorder: Records all of it; None: nobody does.
        robot_server: Socket of the robot server that holds the robots; None: they are emulated here.
    """

    def __init__(
        self,
        cell: Cell,
        gate: Callable[[Cell, str], Judge],
        log: Log,
        keys: Keys | None = None,
        dialects: Sequence[Dialect] = DIALECTS,
        *,
        recorder: Recorder | None = None,
        robot_server: Path | None = None,
    ) -> None:
        clock = cell.config.clock
        lockstep = isinstance(clock, LockstepClockConfig)
        # In lock-step nothing that a client sees may differ between two runs.
        self.start = cell.hash[:16] if lockstep else secrets.token_hex(8)
        self._settings = cell.config.server
        self._max_age = cell.config.max_age_ticks
        self._log = log
        self._dialects = dialects
        self._phase = Phase.RUNNING
        self._status = 0
        self._rest_by = 0.0
        self._over = asyncio.Event()
        self._emptied = asyncio.Event()
        self._sessions: set[Session] = set()
        self._numbers = 0
        self._keys = keys = keys or Keys()
        self._room = ConnectionLimits(
            self._settings.max_connections, self._settings.max_connections_per_address
        )
        self._refused = self._attempts()
        self._listener = self._listening(keys)
        self._access = Access(keys.tokens, self._attempts(), self._log, keys.users)
        # In lock-step the pace is the clients' own, and no tick comes late.
        self._turns = FairScheduler(share=1.0) if lockstep else FairScheduler()
        self._allowances = _allowances(self._settings)
        self._rereading = self._reread_by(keys)
        periods = [robot.period for robot in cell.robots]
        self._pace: WallClockPace | LockstepPace | RobotDrivenPace
        links: list[EmulatedLink] | list[RemoteLink]
        if robot_server is not None:
            self._pace = RobotDrivenPace(robot_server, cell, self.start, self._event, self._idle)
            links = self._pace.links
        else:
            self._pace = (
                LockstepPace(periods, clock.participants, clock.grace, self._instant, log)
                if isinstance(clock, LockstepClockConfig)
                else WallClockPace(periods, self._instant)
            )
            links = [_link(cell, index, self.start) for index in range(len(cell.robots))]
        tap = None if recorder is None else recorder.tap
        self._metrics, judge = self._measured(cell, gate(cell, self.start))
        self._notifier = Notifier()
        runner = GateRunner(judge, {link.robot: link for link in links}, tap)
        # In lock-step what a client is sent must not depend on how fast others are.
        defer = None if lockstep else self._show_later
        heard = ReadTime(self._pace.now, self._turns.holders_queued, self._turns.holders_wait)
        self._core = Core(cell, runner, links, self._pace.now, lockstep, log, defer=defer, heard=heard)
        self._periods = dict(zip((link.robot for link in links), periods, strict=True))
        self._links = links
        self._cell, self._recorder = cell, recorder

    # --- life ---------------------------------------------------------------------------------------------

    async def run(self, announce: Callable[[str, int], None]) -> int:
        """Serve until told to end.

        Args:
            announce: Called once with host and port when clients may connect; without TCP with
                ``unix:PATH`` and 0.

        Returns:
            Exit status: 0, or 1 if something failed.

        Raises:
            OSError: The address cannot be listened on.
            RecorderError: Nothing can be recorded.
            MetricsError: The figures cannot be served.
            SocketError: There is no robot server, or it refuses.
        """
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._unexpected)
        host = self._settings.host
        port = await self._open(host)
        if not self._keys.tcp:
            host = f"unix:{self._keys.socket}"
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.end)
        self._heed_hangup(loop)
        self._log.info("listening", host=host, port=port, start=self.start, lockstep=self._pace.lockstep)
        self._begin()
        self._end_expired()
        announce(host, port)
        self._notifier.ready(f"listening on {host}:{port}")
        await self._over.wait()
        await self._close()
        self._notifier.close()
        if self._metrics is not None:
            await asyncio.to_thread(self._metrics.close)
        self._close_recording()
        return self._status

    async def _open(self, host: str) -> int:
        """Get the robots, then the port, then the recording: each may fail; returns the port."""
        try:
            if isinstance(self._pace, RobotDrivenPace):
                await self._pace.open()
            port = await self._listen(host)
            self._begin_recording()
            self._serve_metrics()
        except BaseException:
            self._pace.close()
            raise
        return port

    async def _listen(self, host: str) -> int:
        if self._keys.socket is not None:
            self._listener.open_local(self._keys.socket)
        return await self._listener.open(host, self._settings.port) if self._keys.tcp else 0

    def end(self) -> None:
        """Stop all robots, wait until they rest, then end; at once if this is called again."""
        if self._phase is not Phase.RUNNING:
            self._log.warning("end.at_once")
            self._finish(1)
            return
        self._notifier.stopping()
        self._log.info("end", robots=self._core.robots)
        self._come_to_rest(Phase.RESTING)
        self._core.ending = True
        try:
            self._core.stop_all("the daemon is ending")
        except Exception as error:
            self.failed(error)
        else:
            self._pace.let_rest(judging=True)
        self._listener.close()

    def failed(self, error: BaseException) -> None:
        """Something of ours failed: trust the gate no more, let the robots play their plans to rest, end."""
        trace = "".join(traceback.format_exception(error))
        self._log.error("failed", error=repr(error), traceback=trace)
        if self._phase in (Phase.FAILED, Phase.OVER):
            return
        self._status = 1
        self._come_to_rest(Phase.FAILED)
        text = "the daemon has failed; its robots come to rest: see its log"
        for session in tuple(self._sessions):
            session.end(RemoteProtocolError(ErrorCode.INTERNAL, text, fatal=True).message())
        self._pace.let_rest(judging=False)
        self._listener.close()

    def _heed_hangup(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._rereading is not None:
            loop.add_signal_handler(signal.SIGHUP, self._rereading.ask)
        elif signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup sets it
            loop.add_signal_handler(signal.SIGHUP, self.end)

    def _show_later(self, peer: Peer, show: Callable[[], None]) -> None:
        self._turns.later(peer.identity, False, show)

    def _begin(self) -> None:
        try:
            if not isinstance(self._pace, RobotDrivenPace):
                self._core.start()
            self._pace.start(self._core)
        except Exception as error:
            self.failed(error)

    def _come_to_rest(self, phase: Phase) -> None:
        self._phase = phase
        playing = max(link.remaining * self._periods[link.robot] for link in self._links)
        self._rest_by = self._pace.now() + playing + _SETTLE

    def _instant(self, instant: Instant) -> None:
        if self._phase is Phase.OVER:
            return
        assert not isinstance(self._pace, RobotDrivenPace)
        if self._phase is Phase.FAILED:
            self._core.advance(instant.time, instant.due)
        else:
            self._warn_of_lateness()
            self._heed_recorder()
            self._measure_lateness(instant.time)
            self._core.tick(instant.time, instant.due, self._pace.step_of(instant))
        if self._phase is not Phase.RUNNING:
            self._look_for_rest(instant.time)

    def _event(self, event: RemoteEvent) -> None:
        """Something came from the robot server."""
        if self._phase is Phase.OVER:
            return
        if self._phase is not Phase.FAILED:
            self._heed_recorder()
            if isinstance(event, Tick):
                self._measure_lateness(event.time)
            try:
                self._core.hear(event)
            except Exception as error:
                self.failed(error)
        elif isinstance(event, Tick):
            self._core.note(event)
        if self._phase is not Phase.RUNNING and isinstance(event, Tick):
            self._look_for_rest(event.time)

    def _idle(self, time: float) -> None:
        """Time passed, whether robots tick or not."""
        if self._phase is Phase.RUNNING:
            self._core.expire()
        elif self._phase is not Phase.OVER and time > self._rest_by:
            self._look_for_rest(time)

    def _look_for_rest(self, time: float) -> None:
        if self._core.at_rest:
            self._log.info("at_rest", at=time)
            self._finish(1 if self._pace.failed else self._status)
        elif time > self._rest_by:
            self._log.error("not_at_rest", at=time)
            self._finish(1)

    def _measure_lateness(self, due: float) -> None:
        if self._metrics is not None and not self._pace.lockstep:
            self._metrics.late(max(0.0, self._pace.now() - due))

    def _warn_of_lateness(self) -> None:
        if isinstance(self._pace, WallClockPace) and (overruns := self._pace.lateness.overruns):
            self._core.warnings["late"] = f"{overruns} ticks came later than the next one was due"

    def _begin_recording(self) -> None:
        if self._recorder is not None:
            header = header_of(self._cell, self.start, self._pace.lockstep, self._pace.now())
            begin(self._recorder, header, self._pace.now)
            self._log.also = self._recorder.log
            self._core.on_state = self._recorder.show
        if self._metrics is not None:
            self._core.on_state = self._both(self._core.on_state, self._metrics)

    @staticmethod
    def _both(first: OnState | None, metrics: "Metrics") -> OnState:
        def show(
            ticks: Sequence[Tick],
            entries: tuple[m.Entry, ...],
            signals: dict[str, m.SignalValue],
            warnings: tuple[str, ...],
            step: int | None,
        ) -> None:
            metrics.show(entries)
            if first is not None:
                first(ticks, entries, signals, warnings, step)

        return show

    def _measured(self, cell: Cell, judge: Judge) -> tuple["Metrics | None", Judge]:
        if cell.config.metrics.port is None:
            return None, judge
        from armgate.daemon.metrics.collector import Metrics  # noqa: PLC0415 (off by default)

        metrics = Metrics(self._queues)
        return metrics, metrics.timed(judge)

    def _serve_metrics(self) -> None:
        wanted = self._cell.config.metrics.port
        if self._metrics is None or wanted is None:
            return
        try:
            port = self._metrics.serve(wanted)
        except OSError as error:
            text = f"metrics.port: cannot listen on 127.0.0.1:{wanted}: {error.strerror or error}"
            raise MetricsError(f"{text}; stop what uses it, or configure another port") from error
        self._log.info("metrics", host="127.0.0.1", port=port)

    def _queues(self) -> dict[str, int]:
        """What waits: records, lines of the log, bytes for clients that read slowly, in all and of one."""
        recorder = {} if self._recorder is None else {"recorder": self._recorder.depth}
        unread = [session.unread for session in tuple(self._sessions)]
        clients = {
            "sessions": len(unread),
            "unread_bytes": sum(unread),
            "unread_bytes_of_one": max(unread, default=0),
        }
        return {**recorder, "log": self._log.depth, **clients}

    def _close_recording(self) -> None:
        """Close the recording; a disk that is full only now is noticed here."""
        recorder = self._recorder
        if recorder is None:
            return
        self._log.also = None
        recorder.close()
        if recorder.seal is not None:
            self._log.info("recording.closed", folder=str(recorder.folder), sha256=recorder.seal.digest.hex())
        if recorder.ended_early or (recorder.required and recorder.trouble):
            self._log.error("recording", text=recorder.trouble)
            self._status = 1

    def _heed_recorder(self) -> None:
        recorder = self._recorder
        if recorder is None or (trouble := recorder.trouble) is None:
            return
        if "recording" not in self._core.warnings:
            self._log.error("recording", text=trouble)
        self._core.warnings["recording"] = trouble
        if recorder.required and self._phase is Phase.RUNNING:
            self._core.stop_unstopped(f"what happens cannot be recorded: {trouble}")

    def _finish(self, status: int) -> None:
        self._status = max(self._status, status)
        self._phase = Phase.OVER
        self._pace.close()
        self._over.set()

    async def _close(self) -> None:
        self._log.info("closing", **self._lateness())
        for session in tuple(self._sessions):
            session.end(m.Bye(reason="the daemon has ended"))
        self._look_for_emptiness()
        try:
            await asyncio.wait_for(self._emptied.wait(), _CLOSE)
        except TimeoutError:
            for session in tuple(self._sessions):
                session.abort()
            await self._emptied.wait()

    def _lateness(self) -> dict[str, float]:
        if not isinstance(self._pace, WallClockPace):
            return {}
        late = self._pace.lateness
        return {"ticks": late.count, "worst": late.worst, "half": late.half, "overruns": late.overruns}

    def _unexpected(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Whatever failed in a callback of the event loop."""
        error = context.get("exception")
        if error is None or isinstance(error, OSError):  # a socket's trouble, not ours
            self._log.warning("loop", text=str(context.get("message")), error=repr(error))
        else:
            self.failed(error)

    # --- sessions -----------------------------------------------------------------------------------------

    def _listening(self, keys: Keys) -> Listener:
        own = self._settings
        return Listener(
            self._session,
            self._room,
            rate=own.connection_rate,
            tls=keys.tls,
            handshake=own.handshake_timeout,
            log=self._log,
            refused=self._refused,
        )

    def _attempts(self) -> FailureLog:
        own = self._settings
        return FailureLog(own.login_failures, own.login_failures_per_address, monotonic())

    def _note(self, event: str, session: Session, **fields: object) -> None:
        """Log what became of a connection that was never welcomed, up to a bound."""
        origin = session.guest.origin
        self._refused.note(self._log, event, origin, monotonic(), session=session.number, **fields)

    def _session(self, guest: Slot) -> Session:
        self._numbers += 1
        allowance = None if self._pace.lockstep else RateLimit(self._allowances, guest.origin)
        return Session(
            self,
            self._numbers,
            guest,
            self._settings.send_buffer,
            self._turns,
            allowance=allowance,
            dialects=self._dialects,
        )

    def opened(self, session: Session) -> None:
        """A connection was made: it may stay if there is room, and says hello in time."""
        self._sessions.add(session)
        if session.guest.refusal:
            session.end(RemoteProtocolError(ErrorCode.TOO_MANY, session.guest.refusal).message())
        elif session.certificate is not None and not is_for_clients(session.certificate):
            self._note("certificate.refused", session)
            session.end(RemoteProtocolError(ErrorCode.UNAUTHORIZED, _NOT_FOR_CLIENTS).message())
        else:
            seconds = self._settings.handshake_timeout
            text = f"no hello within {seconds:g} s; say hello at once after connecting"
            session.allow(seconds, RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, text))

    def hello(self, session: Session, hello: m.Hello) -> None:
        """A client said who it is."""
        try:
            if self._phase is not Phase.RUNNING:
                raise RemoteProtocolError(ErrorCode.SHUTTING_DOWN, "the daemon is ending", about="hello")
            admitted = self._access.admit(hello, session.guest, monotonic(), session.certificate)
            session.name, session.role, session.robots = hello.name, admitted.role, admitted.robots
            session.token = admitted.token
            if admitted.token is not None:
                session.identify(f"token {admitted.token.name}")
            session.id = self._pace.session_id(session.name, session.number)
            self._seat(session)
            self._pace.join(session)
        except RemoteProtocolError as error:
            session.id, error.re = "", hello.id
            if error.code is not ErrorCode.UNAUTHORIZED:  # else it is logged as login.failed
                self._note("refused", session, name=hello.name, code=error.code)
            session.end(error.message())
            return
        session.allow(None)
        session.say(self._welcome(session, hello))
        token = None if admitted.token is None else admitted.token.name
        fields = {"session": session.id, "name": session.name, "role": session.role, "token": token}
        self._log.info("welcome", address=session.address, software=hello.software, **fields)

    def _seat(self, session: Session) -> None:
        token = "" if session.token is None else session.token.name
        if refusal := self._room.admit(session.guest, session.role, token):
            raise RemoteProtocolError(ErrorCode.TOO_MANY, refusal, about="hello")

    def _reread_by(self, keys: Keys) -> Reloader | None:
        sources = [] if keys.reread is None else [ReloadSource("tokens", keys.reread, self._use_tokens)]
        if keys.reread_tls is not None:
            sources.append(ReloadSource("certificates", keys.reread_tls, self._use_tls))
        return Reloader(sources, self._log) if sources or keys.socket is not None else None

    def _end_expired(self) -> None:
        """End the sessions whose token has expired, and look again in a second."""
        now = time()
        for session in tuple(self._sessions):
            if session.greeted and session.token is not None and session.token.expired(now):
                session.expel(RemoteProtocolError(ErrorCode.UNAUTHORIZED, _EXPIRED))
        asyncio.get_running_loop().call_later(_LOOK_FOR_EXPIRED, self._end_expired)

    def _use_tls(self, tls: ssl.SSLContext) -> dict[str, object]:
        self._listener.use_tls(tls)
        return {}

    def _use_tokens(self, tokens: Tokens) -> dict[str, object]:
        """Accept these tokens; end sessions whose token is revoked or changed."""
        self._access.replace(tokens)
        warn_of_unknown_robots(tokens, self._core.robots, self._log)
        valid = {token.grant: token for token in tokens}
        for session in tuple(self._sessions):
            if session.greeted and session.token is not None:
                session.token = valid.get(session.token.grant)
                if session.token is None:
                    session.expel(RemoteProtocolError(ErrorCode.UNAUTHORIZED, _TAKEN_BACK))
        return {"names": [token.name for token in tokens]}

    def said(self, session: Session, message: m.Message) -> None:
        """A client said something."""
        if self._phase in (Phase.RUNNING, Phase.RESTING):
            self._pace.handle(session, message)

    def gone(self, session: Session, reason: str) -> None:
        """A connection is gone, or about to be."""
        if session.greeted:
            self._log.info("gone", session=session.id, name=session.name, reason=reason)
        if session.greeted and self._phase in (Phase.RUNNING, Phase.RESTING):
            self._pace.leave(session)

    def closed(self, session: Session) -> None:
        """A connection is closed."""
        self._sessions.discard(session)
        self._listener.left(session.guest)
        self._look_for_emptiness()

    def privileged(self, session: Session) -> bool:
        """Return True if the session is served first: it holds a robot, or is an operator by token."""
        known = session.token is not None or session.guest.uid is not None
        operator = known and session.role == "operator"
        return operator or self._core.leasing.holds(session.id)

    def _look_for_emptiness(self) -> None:
        if self._phase is Phase.OVER and not self._sessions:
            self._emptied.set()

    def _welcome(self, session: Session, hello: m.Hello) -> m.Welcome:
        limits = m.Limits(
            inbound=INBOUND_LIMIT,
            outbound=OUTBOUND_LIMIT,
            max_age_ticks=self._max_age,
            lease_ttl=self._settings.lease_ttl,
            signals=self._settings.signals_per_client,
            signal_rate=self._settings.signal_rate,
        )
        return answer(
            m.Welcome,
            hello,
            version=session.version,
            versions=tuple(dialect.version for dialect in self._dialects),
            client_versions=hello.versions,
            capabilities=(BODY_EXACT, STOP_REPLACES, SESSIONS),
            start=self.start,
            session=session.id,
            name=session.name,
            role=session.role,
            lockstep=self._pace.lockstep,
            limits=limits,
            software=f"armgate {version('armgate')}",
        )


def _allowances(settings: ServerConfig) -> RateLimits:
    rates = Rates(
        client=settings.message_rate,
        identity=settings.message_rate_per_identity,
        address=settings.message_rate_per_address,
        in_all=settings.message_rate_in_all,
    )
    return RateLimits(rates, monotonic)


def _link(cell: Cell, index: int, start: str) -> EmulatedLink:
    robot = cell.robots[index]
    assert isinstance(robot.config.link, EmulatedLinkConfig), "it is held by the robot server"
    return EmulatedLink(robot.name, start, robot.start.tolist(), robot.period, robot.lags)
