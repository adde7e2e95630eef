"""Every message and every tick: what they do to gate, leases, signals and states. No sockets, no clock."""

from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any

from armgate import events
from armgate.cell.cell import Cell
from armgate.cell.config import ServerConfig, SignalRuleConfig
from armgate.daemon.core import wording
from armgate.daemon.core.description import STOP_REPLACES, CellDescription
from armgate.daemon.core.gate_runner import ClientOutput, GateRunner
from armgate.daemon.core.leasing import LeaseTime, Leasing
from armgate.daemon.core.peer import Peer, answer
from armgate.daemon.core.signals import Reserved, Sharer, Signals
from armgate.daemon.core.states import LatestState, LatestStates
from armgate.links.link import SteppedLink
from armgate.links.log import Log
from armgate.links.robot_server.client import RemoteEvent, RemoteLink
from armgate.protocol import ErrorCode, Leases, ProtocolError, RemoteProtocolError
from armgate.protocol import messages as m

RIGHTS: dict[type[m.Message], frozenset[m.Role]] = {
    m.Describe: frozenset({"observer", "controller", "operator"}),
    m.Asset: frozenset({"observer", "controller", "operator"}),
    m.Subscribe: frozenset({"observer", "controller", "operator"}),
    m.Ping: frozenset({"observer", "controller", "operator"}),
    m.Stop: frozenset({"observer", "controller", "operator"}),
    # Without a lease a command is refused by the gate; like every one that can be read it gets a verdict.
    m.Command: frozenset({"observer", "controller", "operator"}),
    m.Acquire: frozenset({"controller", "operator"}),
    m.Release: frozenset({"controller", "operator"}),
    m.Signal: frozenset({"controller", "operator"}),
    m.Reset: frozenset({"operator"}),
    m.Sessions: frozenset({"operator"}),
    m.Kick: frozenset({"operator"}),
}
"""Which role may send what. Taking a lease over is the operator's too; the lease machine sees to it."""

OnState = Callable[
    [Sequence[events.Tick], tuple[m.Entry, ...], dict[str, m.SignalValue], tuple[str, ...], int | None], None
]

_OURSELVES = "daemon"

_NEVER = LeaseTime(0.0, 0.0)

Defer = Callable[[Peer, Callable[[], None]], None]
"""Calls a function on behalf of a peer, when it is that peer's turn."""


class Core:
    """One cell's gate, links, leases, signals and states.

    Args:
        cell: The cell.
        runner: Asks its gate.
        links: Each robot's link, in the order of the configuration: made to tick by somebody's clock, or
            telling of ticks by themselves (`hear`).
        now: Daemon time, s.
        lockstep: Whether time passes in lock-step; leases do not expire then.
        log: Where events are told.
        defer: Calls a function when it is a peer's turn. With it, peers that hold no robot are sent states
            in their turn, so that a command in between does not wait for all of them. If their turn has not
            come when the next state is due, that one replaces it.
        heard: Daemon time up to which everything that clients sent has been read, s; ``now`` if not given.

    Attributes:
        peers: The sessions by id.
        warnings: What the states shall warn of, by what it is about.
        ending: Whether the daemon is ending: nothing is reset any more.
        on_state: Told of every instant: ticks, all entries, signals, warnings, and its number in lock-step.
    """

    def __init__(
        self,
        cell: Cell,
        runner: GateRunner,
        links: Sequence[SteppedLink] | Sequence[RemoteLink],
        now: Callable[[], float],
        lockstep: bool,
        log: Log,
        *,
        defer: Defer | None = None,
        heard: Callable[[], float] | None = None,
    ) -> None:
        server = cell.config.server
        self.robots = tuple(robot.name for robot in cell.robots)
        self.peers: dict[str, Peer] = {}
        self.warnings: dict[str, str] = {}
        self.ending = False
        self.on_state: OnState | None = None
        leases = Leases(self.robots, server.lease_ttl)
        self.leasing = Leasing(
            leases, self.peers, self._lease_changed, lambda robot: runner.view(robot).stops
        )
        # Two measurements of a robot that stands differ by up to twice the tolerance.
        self._noise = {robot.name: 2.0 * robot.q_tolerance for robot in cell.robots}
        self._links: tuple[SteppedLink | RemoteLink, ...] = tuple(links)
        self._runner = runner
        self._now = now
        self._lockstep = lockstep
        self._log = log
        self._signals = _signals(server)
        self._board = LatestStates(self.robots)
        self._library = CellDescription(cell, lockstep)
        self._ticks: dict[str, events.Tick] = {}
        self._moved: dict[str, float] = {}
        self._defer = defer
        self._heard = now if heard is None else heard
        self._unshown: dict[str, dict[str, LatestState]] = {}

    # --- time ---------------------------------------------------------------------------------------------

    def start(self) -> None:
        """The links are there: tell the gate."""
        for robot in self.robots:
            self._feed(events.LinkChange(robot, events.LinkState.READY))

    def tick(self, time: float, due: Sequence[int], step: int | None = None) -> None:
        """Let the robots tick that are due, then tell everybody.

        Args:
            time: Daemon time of the instant, s.
            due: Indices of the robots, ascending.
            step: Number of the instant in lock-step.
        """
        ticks = self.advance(time, due)
        self.leasing.expire(self._lease_time)
        for tick in ticks:
            self._feed(tick)
        self._publish(ticks, step)

    def advance(self, time: float, due: Sequence[int]) -> list[events.Tick]:
        """Let the robots tick without asking the gate: they play their plans out and rest."""
        ticks = []
        for index in due:
            link = self._links[index]
            assert not isinstance(link, RemoteLink)
            ticks.append(link.advance(time))
        for tick in ticks:
            self.note(tick)
        return ticks

    def hear(self, event: RemoteEvent) -> None:
        """A robot that is its own clock told something: judge it, then tell everybody."""
        if not isinstance(event, events.Tick):
            self._feed(event)
            if isinstance(event, events.LinkChange):
                self._put(tuple(self._ticks.values()), None)  # no tick may come that would tell
            return
        self.note(event)
        self.leasing.expire(self._lease_time)
        self._feed(event)
        self._publish([event], None)

    def note(self, tick: events.Tick) -> None:
        """Keep what a robot did last, to know when it rests."""
        before = self._ticks.get(tick.robot, tick)
        # What was just played is measured at the next tick: until then it counts by itself.
        moved = (abs(a - b) for a, b in zip(tick.q, before.q, strict=True))
        self._moved[tick.robot] = max(*moved, *map(abs, tick.increment))
        self._ticks[tick.robot] = tick

    def expire(self) -> None:
        """End the leases whose holders were silent for too long, though no robot ticks."""
        self.leasing.expire(self._lease_time)

    @property
    def at_rest(self) -> bool:
        """Whether no robot has anything left to play, nor was measured to move at its last tick."""
        return not any(link.remaining for link in self._links) and all(
            moved <= self._noise[robot] for robot, moved in self._moved.items()
        )

    @property
    def _lease_time(self) -> LeaseTime:
        # In lock-step the barrier finds out who is silent; how fast virtual time passes ends no lease.
        return _NEVER if self._lockstep else LeaseTime(self._now(), self._heard())

    # --- sessions -----------------------------------------------------------------------------------------

    def join(self, peer: Peer) -> None:
        """A session said hello."""
        self.peers[peer.id] = peer

    def leave(self, peer: Peer) -> None:
        """A session is gone: its robots and signals are free, its robots play their plans to rest."""
        if self.peers.get(peer.id) is peer:
            self.leasing.leave(peer)
            self._signals.drop(peer.id)
            self._unshown.pop(peer.id, None)
            del self.peers[peer.id]

    def handle(self, peer: Peer, message: m.Message) -> None:
        """Do what a client asks, or tell it why not."""
        try:
            self.leasing.renew(peer, self._lease_time)
            self._may(peer, message)
            self._do(peer, message)
        except ProtocolError as error:
            if error.re is None and isinstance(message, m.Request):
                error.re = message.id
            peer.say(error.message())

    def check_command(self, command: m.Command) -> None:
        """Whether there is such a robot.

        Raises:
            RemoteProtocolError: ``unknown_robot``, with the command's seq.
        """
        self._known(command.robot, "command", command.seq)

    def judge(self, peer: Peer, command: m.Command) -> None:
        """Have a command judged; its sender gets the verdict."""
        fence = self.leasing.fence(peer, command, self._lease_time)
        event = events.Command(command.robot, fence, command.seq, command.tick, command.dq)
        self._feed(event, peer)

    def stop_all(self, reason: str) -> None:
        """Stop all robots on behalf of the daemon itself."""
        self._feed(events.Stop(self.robots, reason, _OURSELVES))

    def stop_unstopped(self, reason: str) -> None:
        """The same, unless every one is stopped already."""
        if any(not self._runner.view(robot).stops for robot in self.robots):
            self.stop_all(reason)

    def broadcast(self, message: m.Message) -> None:
        """Tell everybody."""
        for peer in tuple(self.peers.values()):
            peer.say(message)

    # --- requests -----------------------------------------------------------------------------------------

    def _may(self, peer: Peer, message: m.Message) -> None:
        if isinstance(message, m.Pass):
            text = "pass: this daemon runs by the wall clock, not in lock-step; send no pass"
            raise RemoteProtocolError(ErrorCode.NO_LOCKSTEP, text, about="pass")
        if peer.role not in RIGHTS[type(message)]:
            roles = " or ".join(sorted(RIGHTS[type(message)]))
            text = f"{message.type}: not as {peer.role}; connect as {roles}"
            raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about=message.type)
        if isinstance(message, m.Acquire) and peer.robots is not None and message.robot not in peer.robots:
            text = f"acquire: your token is not for {message.robot}; use one that names it"
            raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about="acquire")

    def _known(self, robot: str, about: str, seq: int | None = None) -> None:
        if robot not in self.robots:
            text = f"no robot {robot}; the cell has {', '.join(self.robots)}"
            raise RemoteProtocolError(ErrorCode.UNKNOWN_ROBOT, text, about=about, seq=seq)

    def _do(self, peer: Peer, message: m.Message) -> None:
        match message:
            case m.Command():
                self.check_command(message)
                self.judge(peer, message)
            case m.Signal():
                sharer = Sharer(peer.id, peer.name, peer.role, peer.known_as)
                self._signals.set(sharer, message.name, message.value, self._now())
                peer.say(answer(m.Signaled, message, name=message.name))
            case m.Acquire():
                self.leasing.acquire(peer, message, self._lease_time)
            case m.Release():
                self.leasing.release(peer, message, self._lease_time)
            case m.Subscribe():
                self._subscribe(peer, message)
            case m.Describe():
                peer.say(*self._library.describe(message.id))
            case m.Asset():
                peer.say(_re(self._library.chunk(message.hash, message.offset, message.length), message))
            case m.Stop():
                self._stop(peer, message)
            case m.Reset():
                self._reset(peer, message)
            case m.Sessions():
                peer.say(answer(m.SessionList, message, sessions=self._sessions()))
            case m.Kick():
                self._kick(peer, message)
            case m.Ping():
                now = self._now()
                peer.say(answer(m.Pong, message, time=message.time, received=now, sent=now))

    def _subscribe(self, peer: Peer, request: m.Subscribe) -> None:
        subscription = self._board.subscription(request)
        peer.subscription = subscription if subscription.every else None
        peer.drop_states()
        self._unshown.pop(peer.id, None)  # it is shown the newest right below
        robots = self._board.subscribed_robots(subscription)
        fields = subscription.fields
        peer.say(answer(m.Subscribed, request, every=request.every, robots=robots, fields=fields))
        if subscription.every:
            newest = map(self._board.newest, robots)
            peer.show(*(state.of(fields) for state in newest if state is not None))

    # --- sessions of others ------------------------------------------------------------------------------

    def _sessions(self) -> tuple[m.SessionInfo, ...]:
        return tuple(self._session(peer) for peer in islice(self.peers.values(), m.MAX_SESSIONS))

    def _session(self, peer: Peer) -> m.SessionInfo:
        held = self.leasing.held_by(peer.id)
        return m.SessionInfo(
            session=peer.id,
            name=peer.name,
            role=peer.role,
            token=peer.token_name,
            address=peer.address,
            robots=tuple(robot for robot in self.robots if robot in held),
        )

    def _kick(self, peer: Peer, request: m.Kick) -> None:
        other = self.peers.get(request.session)
        if other is None:
            text = f"no session {request.session}; `sessions` lists those that there are"
            raise RemoteProtocolError(ErrorCode.UNKNOWN_SESSION, text, about="kick")
        self._log.warning("kicked", session=other.id, name=other.name, by=peer.name, reason=request.reason)
        peer.say(answer(m.Kicked, request, session=other.id))
        reason = f": {request.reason}" if request.reason else ""
        other.expel(RemoteProtocolError(ErrorCode.KICKED, f"{peer.name} ended this session{reason}"))

    # --- stop and reset -----------------------------------------------------------------------------------

    def _stop(self, peer: Peer, request: m.Stop) -> None:
        if request.robot is not None:
            self._known(request.robot, "stop")
        robots = self.robots if request.robot is None else (request.robot,)
        self._feed(events.Stop(robots, request.reason, peer.name), peer, request)

    def _reset(self, peer: Peer, request: m.Reset) -> None:
        if self.ending:
            text = "the daemon is ending: nothing is reset any more"
            raise RemoteProtocolError(ErrorCode.SHUTTING_DOWN, text, fatal=False, about="reset")
        if STOP_REPLACES in peer.capabilities and not self._in_force(request.stop):
            # It may have been replaced by a stop that this operator has not seen yet.
            raise RemoteProtocolError(*_unknown_stop(request.stop), about="reset")
        self._feed(events.Reset(request.stop, peer.name), peer, request)

    def _in_force(self, stop: int) -> bool:
        return any(stop in self._runner.view(robot).stops for robot in self.robots)

    def _stopped(self, stopped: events.Stopped, asker: Peer | None, request: m.Request | None) -> None:
        reason = wording.text(stopped.reason)
        fields: dict[str, Any] = {
            "stop": stopped.id,
            "robots": stopped.robots,
            "reason": reason,
            "by": stopped.by,
        }
        if stopped.replaces is not None:
            fields["replaces"] = stopped.replaces
        self._log.warning("stopped", **fields)
        for peer in tuple(self.peers.values()):
            peer.say(answer(m.Stopped, request if peer is asker else None, **fields))
        self.leasing.stop(stopped.robots, wording.text(f"stop {stopped.id} by {stopped.by}: {reason}"))

    def _resumed(self, reset: events.ResetAnswer, asker: Peer | None, request: m.Request | None) -> None:
        if asker is None or not isinstance(request, m.Reset):
            return  # nobody asked: nothing to tell
        if not reset.accepted:
            raise RemoteProtocolError(*_NO_RESET[reset.reason](reset.stop), about="reset")
        self._log.info("resumed", stop=reset.stop, by=asker.name)
        self.leasing.resume(robot for robot in self.robots if not self._runner.view(robot).stops)
        in_force = reset.stop if reset.lifted is None else reset.lifted
        for peer in tuple(self.peers.values()):
            if peer is asker:
                more = {} if reset.lifted is None else {"lifted": reset.lifted}
                peer.say(answer(m.Resumed, request, stop=reset.stop, by=asker.name, **more))
            else:
                peer.say(answer(m.Resumed, None, stop=in_force, by=asker.name))

    # --- the gate -----------------------------------------------------------------------------------------

    def _lease_changed(self, change: events.LeaseChange) -> None:
        self._feed(change)

    def _feed(
        self, event: events.GateEvent, asker: Peer | None = None, request: m.Request | None = None
    ) -> None:
        """Have an event judged; tell what comes of it, answers to the one who asked."""
        for told in self._runner.feed(event):
            self._tell(told, asker, request)

    def _tell(self, told: ClientOutput, asker: Peer | None, request: m.Request | None) -> None:
        match told:
            case events.Verdict():
                if asker is not None:
                    asker.say(wording.verdict(told))
            case events.Stopped():
                self._stopped(told, asker, request)
            case events.ResetAnswer():
                self._resumed(told, asker, request)

    def _publish(self, ticks: Sequence[events.Tick], step: int | None) -> None:
        self._put(ticks, step)
        self._show_to_all(ticks)

    def _put(self, ticks: Sequence[events.Tick], step: int | None) -> None:
        """Note what the states at these ticks say."""
        entries = tuple(self._entry(robot) for robot in self.robots if robot in self._ticks)
        warnings = wording.warnings((*self.warnings.values(), *self._runner.warnings()))
        if self.on_state is not None:
            self.on_state(ticks, entries, self._signals.values, warnings, step)
        for tick in ticks:
            self._board.put(tick, entries, self._signals.values, warnings, step)

    def _show_to_all(self, ticks: Sequence[events.Tick]) -> None:
        """Show the state to holders at once: they answer before the next tick; to others in their turn."""
        holders = self.leasing.sessions
        for peer in tuple(self.peers.values()):
            if wanted := self._wanted(peer, ticks):
                if self._defer is None or peer.id in holders:
                    self._show(peer, _newer(self._unshown.pop(peer.id, {}), wanted))
                else:
                    self._show_later(self._defer, peer, wanted)

    def _wanted(self, peer: Peer, ticks: Sequence[events.Tick]) -> dict[str, LatestState]:
        """Return the states at these ticks that a peer has subscribed, by robot."""
        wanted = peer.subscription
        if wanted is None:
            return {}
        return {
            tick.robot: newest
            for tick in ticks
            if wanted.wants(tick.robot, tick.tick) and (newest := self._board.newest(tick.robot)) is not None
        }

    def _show_later(self, defer: Defer, peer: Peer, wanted: dict[str, LatestState]) -> None:
        waiting = self._unshown.get(peer.id)
        self._unshown[peer.id] = _newer(waiting or {}, wanted)
        if waiting is None:
            defer(peer, lambda: self._show(peer, self._unshown.pop(peer.id, {})))

    def _show(self, peer: Peer, wanted: dict[str, LatestState]) -> None:
        subscription = peer.subscription
        if subscription is not None and wanted:
            peer.show(*(newest.of(subscription.fields) for newest in wanted.values()))

    def _entry(self, robot: str) -> m.Entry:
        return wording.entry(robot, self._runner.view(robot), self.leasing.holder(robot))


def _signals(server: ServerConfig) -> Signals:
    rules = {"operator.": SignalRuleConfig(role="operator")} | server.signals
    reserved = {
        prefix: Reserved(rule.role == "operator", None if rule.clients is None else frozenset(rule.clients))
        for prefix, rule in rules.items()
    }
    return Signals(server.signal_rate, server.signals_per_client, reserved)


def _newer(waiting: dict[str, LatestState], newer: dict[str, LatestState]) -> dict[str, LatestState]:
    """Replace states that wait by newer ones of the same robots; the result is in the order of time."""
    return {robot: state for robot, state in waiting.items() if robot not in newer} | newer


def _unknown_stop(stop: int) -> tuple[ErrorCode, str]:
    return ErrorCode.UNKNOWN_STOP, f"no stop {stop} is in force; the state's entries name those that are"


def _moving(stop: int) -> tuple[ErrorCode, str]:
    return (
        ErrorCode.MOVING,
        f"a robot of stop {stop} still moves, or has not spoken since its link was lost; reset when it rests",
    )


_NO_RESET: dict[str, Callable[[int], tuple[ErrorCode, str]]] = {"unknown": _unknown_stop, "moving": _moving}


def _re(message: m.Answer, request: m.Request) -> m.Answer:
    return message if request.id is None else message.model_copy(update={"re": request.id})
