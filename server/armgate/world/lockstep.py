"""Lock-step: time is virtual, and a step ends when every participant is done with it.

The messages that a client receives depend only on the messages of the participants in each step, never on
their speed. Commands therefore wait for the end of the step and are decided in the order of the robots.
Messages that a participant sends after it is done with a step count in the next step. Only pings are answered
at once. A stop from a participant that is done waits, too: no time passes meanwhile.

Two shells drive it: `armgate.daemon.pace.lockstep` in an event loop, `armgate.world.world` without one.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from armgate.emulator import VirtualClock
from armgate.protocol import ErrorCode, ProtocolError, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.barrier import Barrier, Presence
from armgate.world.core import Core
from armgate.world.interfaces import Batch, ClientRequest, EventLog, Peer

_AHEAD = 256
"""Number of messages of a participant that may wait for the next step."""

_END_NO_STEP = frozenset({m.Signal, m.Ping, m.Subscribe, m.Describe, m.Asset})
"""Messages that cannot end a step: they change neither leases nor the set of participants that are done."""


Due = Callable[[float, Sequence[int], int], None]
"""Function that makes robots tick: virtual time, s; indices of the robots; number of the step."""


class Lockstep:
    """Lock-step of one cell: barrier, virtual clock and order of requests; a `RequestHandler`.

    Args:
        periods: Periods of the robots, s, in the order of the configuration.
        participants: Names of the clients that each step waits for.
        grace: Time for which a participant may send nothing while a step waits for it, s of the wall clock.
        log: Receives events.
        wall: The wall clock, used only for the grace, s.
        automatic: True if a step ends as soon as it is complete; False if it ends only by `advance`.
    """

    def __init__(
        self,
        periods: Sequence[float],
        participants: Sequence[str],
        grace: float,
        log: EventLog,
        wall: Callable[[], float],
        *,
        automatic: bool = True,
    ) -> None:
        self._clock = VirtualClock(periods)
        self._barrier = Barrier(participants, grace, self._held_by)
        self._grace = grace
        self._log = log
        self._wall = wall
        self._automatic = automatic
        self._core: Core
        self._due: Due
        self._time = 0.0
        self._sessions: dict[str, Peer] = {}
        self._done_batches: dict[str, Batch] = {}
        self._commands: list[tuple[Peer, m.Command]] = []
        self._ahead: dict[str, deque[ClientRequest | None]] = {name: deque() for name in participants}
        self._resting = self._failed = False

    @property
    def failed(self) -> bool:
        """True if a participant was dropped."""
        return self._failed

    @property
    def complete(self) -> bool:
        """True if all participants are present and done with the step."""
        return self._barrier.complete

    @property
    def step(self) -> int:
        """Number of the current step, -1 before the start."""
        return self._barrier.step

    def now(self) -> float:
        """Return daemon time, s: virtual."""
        return self._time

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session; that of a participant does not depend on the order of connections."""
        return f"p{self._barrier.names.index(name)}" if name in self._barrier else f"s{number}"

    def attach(self, core: Core) -> None:
        """Pass requests to this core; called before `start`, so that clients may join before it."""
        self._core = core

    def start(self, core: Core, due: Due) -> None:
        """Begin with the first instant; the next one waits for the participants.

        Args:
            core: Processes requests.
            due: Makes robots tick.
        """
        self._core, self._due = core, due
        core.start()
        self._log.info("lockstep", participants=self._barrier.names)
        self.advance()

    def let_rest(self, decide: bool) -> bool:
        """Stop waiting for participants: from now on a step ends only by `advance`.

        Args:
            decide: True if commands that wait are still passed to the gate.

        Returns:
            False if this was called before.
        """
        if not decide:
            self._commands.clear()
            for ahead in self._ahead.values():
                ahead.clear()
        first, self._resting = not self._resting, True
        return first

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
            peer.keep_states()  # what it receives must not depend on how fast it reads
        self._core.join(peer)

    def handle(self, peer: Peer, request: ClientRequest) -> None:
        """Process a request in this step, or in the next one if its participant is done with this one."""
        name = peer.client.name
        if self._sessions.get(name) is peer:
            self._handle_participant(name, peer, request)
        else:
            self._handle_other(peer, request)
        if type(request) not in _END_NO_STEP:
            # also after a stop by an observer: a participant that loses its robot may be done now
            self._go_on()
            if self._takes_part(peer):
                self._hold_if_done(peer)

    def leave(self, peer: Peer) -> None:
        """Remove a session; a participant that is done with the step leaves at the end of the step."""
        if not self._takes_part(peer):
            self._core.leave(peer)
        elif self._barrier.done(peer.client.name):
            self._ahead[peer.client.name].append(None)
        else:
            self._part(peer)
        self._go_on()

    def _takes_part(self, peer: Peer) -> bool:
        return self._sessions.get(peer.client.name) is peer

    def _held_by(self, name: str) -> frozenset[str]:
        peer = self._sessions.get(name)
        return frozenset() if peer is None else self._core.leasing.held_by(peer.client.id)

    def _handle_participant(self, name: str, peer: Peer, request: ClientRequest) -> None:
        self._barrier.note_message(name, self._wall())
        if self._barrier.done(name) and not isinstance(request, m.Ping):
            self._keep(peer, request)
        else:
            self._process(peer, request)

    def _handle_other(self, peer: Peer, request: ClientRequest) -> None:
        """Process a request of a client that is no participant: it cannot hold robots or set signals."""
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
        while self._automatic and not self._resting and self._barrier.complete:
            self.advance()

    def advance(self) -> None:
        """End the step, and send each client its verdict and the next state together, participants first."""
        done, self._done_batches = self._done_batches, {}
        participants = self._slowest_first(done)
        others = [peer for peer in self._core.peers.values() if not self._takes_part(peer)]
        batches = [peer.batch() for peer in (*participants, *others)]
        try:
            self._end_step()
        finally:
            for batch in done.values():
                batch.close()
            for batch in batches:
                batch.close()
                batch.flush()  # while a session is read, another batch of it is open, which holds frames back
        for peer in participants:
            if self._takes_part(peer):
                self._hold_if_done(peer)

    def _slowest_first(self, done: Iterable[str]) -> list[Peer]:
        """Return the participants in the order in which they are sent the next state.

        The one that was done last is sent its state first, because the next step will wait for it, too.

        Args:
            done: Names of participants that were done, in order; a missing one was done last, or not at all.
        """
        before = list(done)
        names = [*(name for name in self._sessions if name not in before), *reversed(before)]
        return [self._sessions[name] for name in names]

    def _end_step(self) -> None:
        """Pass the commands to the gate, make the robots tick, then process messages that were sent ahead."""
        commands, self._commands = sorted(self._commands, key=self._order), []
        for peer, command in commands:
            # A client that has left receives no verdict: whether it came in time would depend on its speed.
            self._core.command(peer, command, answer=self._takes_part(peer))
        instant = self._clock.advance()
        self._time = instant.time
        ticked = [self._core.robots[index] for index in instant.due]
        self._barrier.begin(instant.number, ticked, self._wall())
        self._due(instant.time, instant.due, instant.number)
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
