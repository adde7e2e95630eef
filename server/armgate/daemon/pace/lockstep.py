"""Virtual time: a step ends when every participant has had its say.

What a client is sent depends only on what participants say in which step, never on who was faster: commands
wait for the end of the step and are judged in the order of the robots; whatever a participant says after it
is done with a step counts in the next one; daemon time is virtual. Pings alone are answered at once. A stop
from a participant that is done waits like everything else: no time passes meanwhile.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from time import monotonic

from armgate.daemon.core.core import Core
from armgate.daemon.core.peer import Peer
from armgate.daemon.pace.barrier import Barrier, Presence
from armgate.emulator import Instant, VirtualClock
from armgate.links.log import Log
from armgate.protocol import ErrorCode, ProtocolError, RemoteProtocolError
from armgate.protocol import messages as m

_AHEAD = 256
"""How many messages of a participant may wait for the next step."""

_END_NO_STEP = (m.Signal, m.Ping, m.Subscribe, m.Describe, m.Asset)
"""They change nothing of who holds what, nor who is done: no step ends by them."""


class LockstepPace:
    """Makes the robots tick when the participants have answered.

    Args:
        periods: The robots' periods, s, in the order of the configuration.
        participants: The names that are waited for.
        grace: How long a participant may be silent while all wait for it, s of the wall clock.
        on_instant: Called with each instant.
        log: Where events are told.
        wall: The wall clock, for the grace alone, s.
    """

    lockstep = True

    def __init__(
        self,
        periods: list[float],
        participants: tuple[str, ...],
        grace: float,
        on_instant: Callable[[Instant], None],
        log: Log,
        wall: Callable[[], float] = monotonic,
    ) -> None:
        self._clock = VirtualClock(periods)
        self._barrier = Barrier(participants, grace, self._held_by)
        self._grace = grace
        self._on_instant = on_instant
        self._log = log
        self._wall = wall
        self._core: Core
        self._time = 0.0
        self._sessions: dict[str, Peer] = {}
        self._hushed: dict[str, Peer] = {}
        self._waiting: list[tuple[Peer, m.Command]] = []
        self._ahead: dict[str, deque[m.Message | None]] = {name: deque() for name in participants}
        self._watch: asyncio.TimerHandle | None = None
        self._resting = self._closed = False
        self.failed = False

    def now(self) -> float:
        """Daemon time, s: virtual."""
        return self._time

    def step_of(self, instant: Instant) -> int | None:
        """Number that states give to this instant."""
        return instant.number

    def session_id(self, name: str, number: int) -> str:
        """Id of the session with this name: a participant's does not depend on who connected first."""
        return f"p{self._barrier.names.index(name)}" if name in self._barrier else f"s{number}"

    def start(self, core: Core) -> None:
        """Begin with the first instant; the next one waits for the participants."""
        self._core = core
        self._log.info("lockstep", participants=self._barrier.names)
        self._step()
        self._arm()

    def close(self) -> None:
        """No further instant comes."""
        self._closed = True
        if self._watch is not None:
            self._watch.cancel()

    def let_rest(self, judging: bool) -> None:
        """Go on, waiting for nobody, until somebody closes this.

        Args:
            judging: Whether what waits is still judged.
        """
        if not judging:
            self._waiting.clear()
            for ahead in self._ahead.values():
                ahead.clear()
        if not self._resting:
            self._resting = True
            asyncio.get_running_loop().call_soon(self._run_on)

    # --- sessions -----------------------------------------------------------------------------------------

    def join(self, peer: Peer) -> None:
        """A session said hello.

        Raises:
            RemoteProtocolError: ``name_taken``: a participant of this name is here already.
        """
        if peer.name in self._barrier:
            if self._barrier.presence(peer.name) is Presence.PRESENT:
                text = f"participant {peer.name} is connected already; every name takes part once"
                raise RemoteProtocolError(ErrorCode.NAME_TAKEN, text, about="hello")
            self._barrier.join(peer.name, self._wall())
            self._sessions[peer.name] = peer
        self._core.join(peer)

    def handle(self, peer: Peer, message: m.Message) -> None:
        """A client said something: it counts in this step, or in the next one if it was done with this."""
        if not self._takes_part(peer):
            self._from_outside(peer, message)
            return
        self._barrier.heard(peer.name, self._wall())
        if self._barrier.done(peer.name) and not isinstance(message, m.Ping):
            self._keep(peer, message)
        else:
            self._count(peer, message)
        if not isinstance(message, _END_NO_STEP):
            self._go_on()
            self._hush(peer)

    def leave(self, peer: Peer) -> None:
        """A session is gone; one that was done with the step leaves after it."""
        if not self._takes_part(peer):
            self._core.leave(peer)
        elif self._barrier.done(peer.name):
            self._ahead[peer.name].append(None)
        else:
            self._part(peer)
        self._go_on()

    def _takes_part(self, peer: Peer) -> bool:
        return self._sessions.get(peer.name) is peer

    def _held_by(self, name: str) -> set[str]:
        peer = self._sessions.get(name)
        return set() if peer is None else self._core.leasing.held_by(peer.id)

    def _from_outside(self, peer: Peer, message: m.Message) -> None:
        """Others may look on and stop, but what changes a run is the participants'."""
        if isinstance(message, m.Acquire | m.Signal | m.Pass):
            names = ", ".join(self._barrier.names)
            text = (
                f"{message.type}: {peer.name} does not take part in the lock-step; connect as one of {names}"
            )
            error = RemoteProtocolError(
                ErrorCode.NOT_PARTICIPANT, text, about=message.type, re=getattr(message, "id", None)
            )
            peer.say(error.message())
        else:
            self._core.handle(peer, message)

    def _keep(self, peer: Peer, message: m.Message) -> None:
        ahead = self._ahead[peer.name]
        if len(ahead) < _AHEAD:
            ahead.append(message)
        else:
            text = f"more than {_AHEAD} messages ahead of step {self._barrier.step}; wait for the next state"
            error = RemoteProtocolError(ErrorCode.TOO_MANY, text, about=message.type)
            error.re, error.seq = getattr(message, "id", None), getattr(message, "seq", None)
            peer.end(error.message())

    def _count(self, peer: Peer, message: m.Message) -> None:
        try:
            match message:
                case m.Command():
                    self._core.check_command(message)
                    self._waiting.append((peer, message))
                    self._barrier.command(peer.name, message.robot)
                case m.Pass():
                    self._barrier.pass_(peer.name, message.step)
                case _:
                    self._core.handle(peer, message)
        except ProtocolError as error:
            peer.say(error.message())

    def _hush(self, peer: Peer) -> None:
        """Who is done waits for the next state: what may wait goes along with that, and wakes it but once."""
        if peer.name not in self._hushed and self._barrier.done(peer.name):
            self._hushed[peer.name] = peer
            peer.hold()

    def _part(self, peer: Peer) -> None:
        self._barrier.leave(peer.name)
        self._core.leave(peer)
        self._sessions.pop(peer.name, None)
        self._hushed.pop(peer.name, None)
        self._ahead[peer.name].clear()

    # --- steps --------------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        while not self._resting and self._barrier.complete:
            self._step()

    def _run_on(self) -> None:
        if not self._closed:
            self._step()
            asyncio.get_running_loop().call_soon(self._run_on)

    def _step(self) -> None:
        """End the step: judge what waits, let the robots tick, then hear what was said ahead."""
        # A verdict and the next state go as one, and first to those who are waited for.
        taking_part = tuple(self._sessions.values())
        onlookers = [peer for peer in self._core.peers.values() if not self._takes_part(peer)]
        hushed, self._hushed = self._hushed, {}
        for peer in (*taking_part, *onlookers):
            peer.hold()
        try:
            self._end_step()
        finally:
            for peer in (*hushed.values(), *taking_part, *onlookers):
                peer.let_go()
            # A session that is being read is held on, and may have said its last word for the next step.
            for peer in (*taking_part, *onlookers):
                peer.flush()
        for peer in taking_part:
            if self._takes_part(peer):
                self._hush(peer)

    def _end_step(self) -> None:
        waiting, self._waiting = sorted(self._waiting, key=self._order), []
        for peer, command in waiting:
            self._core.judge(peer, command)
        instant = self._clock.advance()
        self._time = instant.time
        ticked = [self._core.robots[index] for index in instant.due]
        self._barrier.begin(instant.number, ticked, self._wall())
        self._on_instant(instant)
        for name in self._barrier.names:
            self._hear_ahead(name)

    def _order(self, item: tuple[Peer, m.Command]) -> tuple[int, int]:
        peer, command = item
        return self._core.robots.index(command.robot), self._barrier.names.index(peer.name)

    def _hear_ahead(self, name: str) -> None:
        ahead = self._ahead[name]
        while ahead and not self._barrier.done(name):
            message = ahead.popleft()
            if message is None:
                self._part(self._sessions[name])
            else:
                self._count(self._sessions[name], message)

    # --- grace --------------------------------------------------------------------------------------------

    def _arm(self) -> None:
        self._watch = asyncio.get_running_loop().call_later(self._grace / 4, self._look)

    def _look(self) -> None:
        if not self._closed:
            self.drop_silent()
            self._arm()

    def drop_silent(self) -> None:
        """Drop the participants that were silent for longer than the grace: the run has failed."""
        for name in self._barrier.silent(self._wall()):
            peer = self._sessions[name]
            text = f"participant {name} was silent for {self._grace:g} s in step {self._barrier.step}"
            self._log.error("lockstep.dropped", participant=name, step=self._barrier.step)
            self.failed = True
            self._core.warnings[f"dropped.{name}"] = f"{text} and was dropped: this run has failed"
            self._barrier.drop(name)
            self._part(peer)
            peer.end(RemoteProtocolError(ErrorCode.SILENT, text).message())
        self._go_on()
