"""Core of a cell: processes the requests of clients and the ticks of robots, without sockets and clocks.

The core owns the gate, the leases, the signals and the states of one cell. A daemon passes it the requests
of clients (`join`, `handle`, `leave`) and the reports of robots (`tick`, `receive`). A command takes this
path: `handle`, `_dispatch`, `command`, `GateRunner.feed`, the gate, the link. `_report` sends the verdict.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import assert_never

from armgate import events
from armgate.cell.cell import Cell
from armgate.links.link import Link
from armgate.protocol import ErrorCode, Leases, ProtocolError, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world import session_list, to_protocol
from armgate.world.description import CellDescription
from armgate.world.gate_runner import ClientOutput, GateRunner
from armgate.world.interfaces import ClientRequest, EventLog, Peer
from armgate.world.lease_changes import Effect, LeaseTime, Leasing, Notice
from armgate.world.motion import Motion
from armgate.world.rights import check_rights
from armgate.world.signals import signals_of
from armgate.world.states import Defer, Observer, Snapshot, States
from armgate.world.stopping import Stopping

_DAEMON = "daemon"
"""Name under which the daemon itself stops robots."""


class Core:
    """Gate, links, leases, signals and states of one cell.

    Args:
        cell: The cell.
        gate_runner: Passes events to its gate.
        links: Link of each robot, in the order of the configuration.
        now: Daemon time, s.
        log: Receives events.
        lockstep: True if time passes in lock-step, for the description.
        lease_time: Times of renewal and expiry of leases; None: both are ``now``.
        defer: Calls a function in the turn of a client; see `States`.
        observers: Functions that receive a snapshot of every instant.

    Attributes:
        robots: Names of the robots, in the order of the configuration.
        peers: Sessions by id.
        leasing: Leases in force.
        description: Description of the cell.
    """

    def __init__(
        self,
        cell: Cell,
        gate_runner: GateRunner,
        links: Sequence[Link],
        now: Callable[[], float],
        log: EventLog,
        *,
        lockstep: bool = False,
        lease_time: Callable[[], LeaseTime] | None = None,
        defer: Defer | None = None,
        observers: Iterable[Observer] = (),
    ) -> None:
        self.robots = tuple(robot.name for robot in cell.robots)
        self.peers: dict[str, Peer] = {}
        self.leasing = Leasing(
            Leases(self.robots, cell.config.server.lease_ttl), self.peers, gate_runner.stops
        )
        self._gate_runner = gate_runner
        self._now = now
        self._lease_time = lease_time or (lambda: LeaseTime(now(), now()))
        self._log = log
        self._stopping = Stopping(self.robots, gate_runner, self.peers, log)
        self._signals = signals_of(cell.config.server)
        self._states = States(self.robots, defer, observers)
        self.description = CellDescription(cell, lockstep)
        self._motion = Motion(cell, links)
        self._warnings: dict[str, str] = {}

    # --- robots -------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Report to the gate that all links are ready."""
        for robot in self.robots:
            self._feed(events.LinkChange(robot, events.LinkState.READY))

    def tick(self, ticks: Sequence[events.Tick], step: int | None = None) -> None:
        """Process the ticks of one instant, then publish the states; ``step`` is its number in lock-step."""
        for tick in ticks:
            self._motion.note(tick)
        self.expire()
        for tick in ticks:
            self._feed(tick)
        self._update_states(ticks, step)
        self._states.publish(ticks, self.peers, self.leasing.sessions)

    def receive(self, event: events.LinkChange | events.PlanAnswer) -> None:
        """Process an event of a link that is not a tick."""
        self._feed(event)
        if isinstance(event, events.LinkChange):  # a lost link sends no tick that would update the states
            self._update_states(tuple(self._motion.ticks.values()), None)

    def note(self, ticks: Iterable[events.Tick]) -> None:
        """Track the motion of robots without the gate, after a failure of the gate or the daemon."""
        for tick in ticks:
            self._motion.note(tick)

    def expire(self) -> None:
        """End the leases whose holders sent no message for too long."""
        self._apply(self.leasing.expire(self._lease_time()))

    @property
    def at_rest(self) -> bool:
        """True if no robot has increments left to play, and no robot moved at its last tick."""
        return self._motion.at_rest

    @property
    def time_left(self) -> float:
        """Time until the last robot has played its plan, s."""
        return self._motion.time_left

    # --- the daemon ---------------------------------------------------------------------------------------

    def warn(self, about: str, text: str) -> None:
        """Add a warning to every state from now on; it replaces an earlier one about the same subject."""
        self._warnings[about] = text

    def stop_all(self, reason: str, *, again: bool = True) -> None:
        """Stop all robots on behalf of the daemon.

        Args:
            reason: Reason for the stop.
            again: False to do nothing if a stop is in force for every robot.
        """
        if again or self._stopping.unstopped:
            self._feed(events.Stop(self.robots, reason, _DAEMON))

    def end(self, reason: str) -> None:
        """Stop all robots for good: no stop is reset from now on."""
        self._stopping.refuse_resets()
        self.stop_all(reason)

    # --- clients ------------------------------------------------------------------------------------------

    def join(self, peer: Peer) -> None:
        """Register a session after its hello."""
        self.peers[peer.client.id] = peer

    def leave(self, peer: Peer) -> None:
        """Remove a session: its leases and signals end, and its robots play their plans to rest."""
        if self.peers.get(peer.client.id) is peer:
            self._apply(self.leasing.leave(peer))
            self._signals.drop(peer.client.id)
            self._states.leave(peer)
            del self.peers[peer.client.id]

    def handle(self, peer: Peer, request: ClientRequest) -> None:
        """Answer a request, or send an error with the reason."""
        try:
            self.leasing.renew(peer, self._lease_time())
            check_rights(peer.client, request)
            self._dispatch(peer, request)
        except ProtocolError as error:
            if error.re is None and isinstance(request, m.Request):
                error.re = request.id
            peer.send(error.message())

    # Only lock-step calls `check_robot` and `command` from outside: the former when a command arrives, the
    # latter at the end of the step. With other paces, `handle` calls both at once.

    def check_robot(self, robot: str, about: str, seq: int | None = None) -> None:
        """Check that a request of type ``about`` names a robot of the cell.

        Raises:
            RemoteProtocolError: ``unknown_robot``, with the ``seq`` of a command.
        """
        if robot not in self.robots:
            text = f"no robot {robot}; the cell has {', '.join(self.robots)}"
            raise RemoteProtocolError(ErrorCode.UNKNOWN_ROBOT, text, about=about, seq=seq)

    def command(self, peer: Peer, command: m.Command, *, answer: bool = True) -> None:
        """Pass a command to the gate, after `check_robot`; its sender receives the verdict if ``answer``."""
        self.expire()
        # The gate also checks the holder: a client that guesses a fence does not control the robot.
        holder = self.leasing.is_holder(peer.client.id, command.robot)
        event = events.Command(
            command.robot, command.fence, command.seq, based_on=command.tick, dq=command.dq, holder=holder
        )
        self._feed(event, peer if answer else None)

    def _dispatch(self, peer: Peer, request: ClientRequest) -> None:  # noqa: PLR0912 (one case per message)
        match request:
            case m.Signal():
                self._signal(peer, request)
            case m.Command():
                self.check_robot(request.robot, "command", request.seq)
                self.command(peer, request)
            case m.Ping():
                now = self._now()
                peer.send(to_protocol.answer(m.Pong, request, time=request.time, received=now, sent=now))
            case m.Subscribe():
                self._states.subscribe(peer, request)
            case m.Acquire():
                self._apply(self.leasing.acquire(peer, request, self._lease_time()))
            case m.Release():
                self._apply(self.leasing.release(peer, request, self._lease_time()))
            case m.Stop():
                self._stop(peer, request)
            case m.Reset():
                self._stopping.check_reset(peer, request)
                self._feed(events.Reset(request.stop, peer.client.name), peer, request)
            case m.Describe():
                peer.send(*self.description.describe(request.id))
            case m.Asset():
                assets = self.description.assets
                peer.send(assets.chunk(request.hash, request.offset, request.length, request.id))
            case m.Sessions():
                listed = session_list.list_sessions(self.peers, self.leasing, self.robots)
                peer.send(to_protocol.answer(m.SessionList, request, sessions=listed))
            case m.Kick():
                session_list.kick(self.peers, peer, request, self._log)
            case m.Pass():
                text = "pass: this daemon runs by the wall clock, not in lock-step; send no pass"
                raise RemoteProtocolError(ErrorCode.NO_LOCKSTEP, text, about="pass")
            case _:
                assert_never(request)

    def _signal(self, peer: Peer, request: m.Signal) -> None:
        self._signals.set(peer.client, request.name, request.value, self._now())
        peer.send(to_protocol.signaled(request))

    def _stop(self, peer: Peer, request: m.Stop) -> None:
        if request.robot is not None:
            self.check_robot(request.robot, "stop")
        robots = self.robots if request.robot is None else (request.robot,)
        self._feed(events.Stop(robots, request.reason, peer.client.name), peer, request)

    # --- gate ---------------------------------------------------------------------------------------------

    def _feed(
        self, event: events.GateEvent, asker: Peer | None = None, request: m.Request | None = None
    ) -> None:
        """Pass an event to the gate, and send its outputs; answers go to the client that asked."""
        for output in self._gate_runner.feed(event):
            self._report(output, asker, request)

    def _report(self, output: ClientOutput, asker: Peer | None, request: m.Request | None) -> None:
        match output:
            case events.Verdict():
                if asker is not None:
                    asker.send(to_protocol.verdict(output))
            case events.Stopped():
                reason = self._stopping.announce_stop(output, asker, request)
                self._apply(self.leasing.stop(output.robots, reason))
            case events.ResetAnswer():
                if asker is not None and isinstance(request, m.Reset):
                    self._stopping.announce_reset(output, asker, request)
                    self.leasing.resume(self._stopping.free())
            case _:
                assert_never(output)

    def _apply(self, effects: Iterable[Effect]) -> None:
        """Carry out changes of leases: pass each to the gate, and send notices to the clients concerned."""
        for effect in effects:
            match effect:
                case events.LeaseChange():
                    self._feed(effect)
                case Notice():
                    effect.peer.send(effect.message)
                case _:
                    assert_never(effect)

    # --- states -------------------------------------------------------------------------------------------

    def _update_states(self, ticks: Sequence[events.Tick], step: int | None) -> None:
        warnings = to_protocol.warnings((*self._warnings.values(), *self._gate_runner.warnings()))
        self._states.put(Snapshot(ticks, self._entries(), self._signals.values, warnings, step))

    def _entries(self) -> tuple[m.Entry, ...]:
        return tuple(
            to_protocol.entry(robot, self._gate_runner.view(robot), self.leasing.holder(robot))
            for robot in self.robots
            if robot in self._motion.ticks
        )
