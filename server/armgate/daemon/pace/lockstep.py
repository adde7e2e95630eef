"""Lock-step: time is virtual, and a step ends when every participant is done with it.

The messages that a client receives depend only on the messages of the participants in each step, never on
their speed. Commands therefore wait for the end of the step and are decided in the order of the robots.
Messages that a participant sends after it is done with a step count in the next step. Only pings are answered
at once. A stop from a participant that is done waits, too: no time passes meanwhile.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from time import monotonic

from armgate.daemon.pace.pace import TickReceiver
from armgate.emulator import VirtualClock
from armgate.protocol import ErrorCode, ProtocolError, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.barrier import Barrier, Presence
from armgate.world.core import Core
from armgate.world.interfaces import Batch, ClientRequest, EventLog, Peer

_AHEAD = 256
"""Number of messages of a participant that may wait for the next step."""

_END_NO_STEP = (m.Signal, m.Ping, m.Subscribe, m.Describe, m.Asset)
"""Messages that cannot end a step: they change neither leases nor the set of participants that are done."""


class LockstepPace:
    """Pace in which the robots tick when the participants are done; also the `RequestHandler` of sessions.

    Args:
        periods: Periods of the robots, s, in the order of the configuration.
        participants: Names of the clients that each step waits for.
        grace: Time for which a participant may send nothing while a step waits for it, s of the wall clock.
        log: Receives events.
        wall: The wall clock, used only for the grace, s.
    """

    lockstep = True

    def __init__(
        self,
        periods: list[float],
        participants: tuple[str, ...],
        grace: float,
        log: EventLog,
        wall: Callable[[], float] = monotonic,
    ) -> None:
        self._clock = VirtualClock(periods)
        self._barrier = Barrier(participants, grace, self._held_by)
        self._grace = grace
        self._log = log
        self._wall = wall
        self._core: Core
        self._receiver: TickReceiver
        self._time = 0.0
        self._sessions: dict[str, Peer] = {}
        self._done_batches: dict[str, Batch] = {}
        self._commands: list[tuple[Peer, m.Command]] = []
        self._ahead: dict[str, deque[ClientRequest | None]] = {name: deque() for name in participants}
        self._watch: asyncio.TimerHandle | None = None
        self._resting = self._closed = self._failed = False

    @property
    def failed(self) -> bool:
        """True if a participant was dropped."""
        return self._failed

    def now(self) -> float:
        """Return daemon time, s: virtual."""
        return self._time

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session; that of a participant does not depend on the order of connections."""
        return f"p{self._barrier.names.index(name)}" if name in self._barrier else f"s{number}"

    def attach(self, core: Core) -> None:
        """Pass requests to this core; called before `start`, so that clients may join before it."""
        self._core = core

    async def open(self) -> None:
        """Do nothing: the robots are in this process."""

    def start(self, core: Core, receiver: TickReceiver) -> None:
        """Begin with the first instant; the next one waits for the participants."""
        self._core, self._receiver = core, receiver
        core.start()
        self._log.info("lockstep", participants=self._barrier.names)
        self._step()
        self._watch_later()

    def let_rest(self, decide: bool) -> None:
        """Continue without waiting for any participant, until `close`."""
        if not decide:
            self._commands.clear()
            for ahead in self._ahead.values():
                ahead.clear()
        if not self._resting:
            self._resting = True
            asyncio.get_running_loop().call_soon(self._run_on)

    def close(self) -> None:
        """End the pace: there is no further instant."""
        self._closed = True
        if self._watch is not None:
            self._watch.cancel()

    def warnings(self) -> Mapping[str, str]:
        """Return no warnings: in virtual time no tick is late."""
        return {}

    def figures(self) -> Mapping[str, float]:
        """Return no figures."""
        return {}

    # --- sessions -----------------------------------------------------------------------------------------

    def join(self, peer: Peer) -> None:
        """Register a session after its hello.

        Raises:
            RemoteProtocolError: ``name_taken``: a participant of this name is connected.
        """
        name = peer.client.name
        if name in self._barrier:
            if self._barrier.presence(name) is Presence.PRESENT:
                text = f"participant {name} is connected already; each name can take part only once"
                raise RemoteProtocolError(ErrorCode.NAME_TAKEN, text, about="hello")
            self._barrier.join(name, self._wall())
            self._sessions[name] = peer
        self._core.join(peer)

    def handle(self, peer: Peer, request: ClientRequest) -> None:
        """Process a request in this step, or in the next one if its participant is done with this one."""
        if not self._takes_part(peer):
            self._handle_other(peer, request)
            return
        name = peer.client.name
        self._barrier.note_message(name, self._wall())
        if self._barrier.done(name) and not isinstance(request, m.Ping):
            self._keep(peer, request)
        else:
            self._process(peer, request)
        if not isinstance(request, _END_NO_STEP):
            self._go_on()
            self._hold_if_done(peer)

    def leave(self, peer: Peer) -> None:
        """Forget a session; a participant that is done with the step leaves at the end of the step."""
        if not self._takes_part(peer):
            self._core.leave(peer)
        elif self._barrier.done(peer.client.name):
            self._ahead[peer.client.name].append(None)
        else:
            self._part(peer)
        self._go_on()

    def _takes_part(self, peer: Peer) -> bool:
        return self._sessions.get(peer.client.name) is peer

    def _held_by(self, name: str) -> set[str]:
        peer = self._sessions.get(name)
        return set() if peer is None else self._core.leasing.held_by(peer.client.id)

    def _handle_other(self, peer: Peer, request: ClientRequest) -> None:
        """Process a request of a client that takes no part: it may observe and stop, but not change a run."""
        if isinstance(request, m.Acquire | m.Signal | m.Pass):
            names, kind = ", ".join(self._barrier.names), request.type
            text = (
                f"{kind}: {peer.client.name} does not take part in the lock-step; connect as one of {names}"
            )
            re = getattr(request, "id", None)
            error = RemoteProtocolError(ErrorCode.NOT_PARTICIPANT, text, about=kind, re=re)
            peer.send(error.message())
        else:
            self._core.handle(peer, request)

    def _keep(self, peer: Peer, request: ClientRequest) -> None:
        ahead = self._ahead[peer.client.name]
        if len(ahead) < _AHEAD:
            ahead.append(request)
        else:
            text = f"more than {_AHEAD} messages ahead of step {self._barrier.step}; wait for the next state"
            re, seq = getattr(request, "id", None), getattr(request, "seq", None)
            error = RemoteProtocolError(ErrorCode.TOO_MANY, text, about=request.type, re=re, seq=seq)
            peer.close(error.message())

    def _process(self, peer: Peer, request: ClientRequest) -> None:
        try:
            match request:
                case m.Command():
                    self._core.check_robot(request.robot, "command", request.seq)
                    self._commands.append((peer, request))
                    self._barrier.command(peer.client.name, request.robot)
                case m.Pass():
                    self._barrier.pass_(peer.client.name, request.step)
                case _:
                    self._core.handle(peer, request)
        except ProtocolError as error:
            peer.send(error.message())

    def _hold_if_done(self, peer: Peer) -> None:
        """Hold back messages to a participant that is done, so that the next state wakes it only once."""
        name = peer.client.name
        if name not in self._done_batches and self._barrier.done(name):
            self._done_batches[name] = peer.batch()

    def _part(self, peer: Peer) -> None:
        name = peer.client.name
        self._barrier.leave(name)
        self._core.leave(peer)
        self._sessions.pop(name, None)
        self._done_batches.pop(name, None)
        self._ahead[name].clear()

    # --- steps --------------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        while not self._resting and self._barrier.complete:
            self._step()

    def _run_on(self) -> None:
        if not self._closed:
            self._step()
            asyncio.get_running_loop().call_soon(self._run_on)

    def _step(self) -> None:
        """End the step, and send each client its verdict and the next state together, participants first."""
        participants = tuple(self._sessions.values())
        others = [peer for peer in self._core.peers.values() if not self._takes_part(peer)]
        done, self._done_batches = self._done_batches, {}
        batches = [peer.batch() for peer in (*participants, *others)]
        try:
            self._end_step()
        finally:
            for batch in (*done.values(), *batches):
                batch.close()
            # While a session is read, another batch of it is open, which would hold these frames back.
            for batch in batches:
                batch.flush()
        for peer in participants:
            if self._takes_part(peer):
                self._hold_if_done(peer)

    def _end_step(self) -> None:
        """Pass the commands to the gate, make the robots tick, then process messages that were sent ahead."""
        commands, self._commands = sorted(self._commands, key=self._order), []
        for peer, command in commands:
            self._core.command(peer, command)
        instant = self._clock.advance()
        self._time = instant.time
        ticked = [self._core.robots[index] for index in instant.due]
        self._barrier.begin(instant.number, ticked, self._wall())
        self._receiver.due(instant.time, instant.due, instant.number)
        for name in self._barrier.names:
            self._process_ahead(name)

    def _order(self, item: tuple[Peer, m.Command]) -> tuple[int, int]:
        peer, command = item
        return self._core.robots.index(command.robot), self._barrier.names.index(peer.client.name)

    def _process_ahead(self, name: str) -> None:
        ahead = self._ahead[name]
        while ahead and not self._barrier.done(name):
            request = ahead.popleft()
            if request is None:
                self._part(self._sessions[name])
            else:
                self._process(self._sessions[name], request)

    # --- grace --------------------------------------------------------------------------------------------

    def _watch_later(self) -> None:
        self._watch = asyncio.get_running_loop().call_later(self._grace / 4, self._check_grace)

    def _check_grace(self) -> None:
        if not self._closed:
            self.drop_silent()
            self._watch_later()

    def drop_silent(self) -> None:
        """Drop the participants that sent nothing within the grace: the run has failed."""
        for name in self._barrier.silent(self._wall()):
            peer = self._sessions[name]
            text = f"participant {name} sent nothing for {self._grace:g} s in step {self._barrier.step}"
            self._log.error("lockstep.dropped", participant=name, step=self._barrier.step)
            self._failed = True
            self._core.warn(f"dropped.{name}", f"{text} and was dropped: this run has failed")
            self._barrier.drop(name)
            self._part(peer)
            peer.close(RemoteProtocolError(ErrorCode.SILENT, text).message())
        self._go_on()
