"""States: the latest state of every robot, the subscriptions to states, and the order of sending.

A client that holds a robot gets a state at once, because it answers before the next tick. Every other client
gets the state in its turn, so that a command in between does not wait for all clients. If the turn of a
client has not come when the next state of a robot is due, the newer state replaces the older one.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from armgate.events import Tick
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.protocol.unvalidated import unvalidated
from armgate.world import to_protocol
from armgate.world.interfaces import Encoded, Peer

FIELDS: tuple[str, ...] = tuple(
    name for name in m.Entry.model_fields if name not in ("robot", "tick", "time")
)
"""Fields of an entry in addition to robot, tick and time, in the order of the message."""

_ABSENT = dict.fromkeys(m.Entry.model_fields)
"""Values of an entry whose fields are all absent, in the order of the message."""

_BY_THE_WALL_CLOCK = set(m.State.model_fields) - {"type", "re", "step"}
_IN_LOCKSTEP = {*_BY_THE_WALL_CLOCK, "step"}
"""Fields of a state that count as set."""

Defer = Callable[[Peer, Callable[[], None]], None]
"""Function that calls a function in the turn of a client."""


class Snapshot(NamedTuple):
    """Ticks at one moment, and the content of the states at these ticks.

    Attributes:
        ticks: Ticks of the robots that ticked.
        entries: Entries of all robots that have ticked so far.
        signals: Signals by name.
        warnings: Warnings, at most as many as a state may hold.
        step: Number of the instant in lock-step, else None.
    """

    ticks: Sequence[Tick]
    entries: tuple[m.Entry, ...]
    signals: dict[str, m.SignalValue]
    warnings: tuple[str, ...]
    step: int | None = None


Observer = Callable[[Snapshot], None]
"""Function that receives a snapshot of every instant, for example to record it."""


@dataclass(frozen=True, slots=True)
class Subscription:
    """Subscription to every n-th state of some robots, with some fields of the entries."""

    every: int
    robots: frozenset[str]
    fields: tuple[str, ...]

    def wants(self, robot: str, tick: int) -> bool:
        """Return True if the state at this tick is subscribed."""
        return robot in self.robots and tick % self.every == 0


class LatestState:
    """Latest state of one robot; each set of fields is made, and encoded, once for all clients."""

    def __init__(self, state: m.State) -> None:
        self._state = state
        self._encoded: dict[tuple[str, ...], Encoded] = {}

    def of(self, fields: tuple[str, ...]) -> Encoded:
        """Return the state with these fields."""
        known = self._encoded.get(fields)
        if known is None:
            state = self._state if fields == FIELDS else _selected(self._state, fields)
            known = self._encoded[fields] = Encoded(state)
        return known


class States:
    """Latest states, and the clients that subscribe to them.

    Args:
        robots: Names, in the order of the configuration.
        defer: Calls a function in the turn of a client; None: every client is sent states at once.
        observers: Receive every instant, before the clients do.
    """

    def __init__(
        self, robots: Sequence[str], defer: Defer | None = None, observers: Iterable[Observer] = ()
    ) -> None:
        self._robots = tuple(robots)
        self._defer = defer
        self._observers = tuple(observers)
        self._latest: dict[str, LatestState] = {}
        self._subscriptions: dict[str, Subscription] = {}
        self._unsent: dict[str, dict[str, LatestState]] = {}

    # --- subscriptions ------------------------------------------------------------------------------------

    def subscribe(self, peer: Peer, request: m.Subscribe) -> None:
        """Replace the subscription of a client, and send it the latest states.

        Raises:
            RemoteProtocolError: ``unknown_robot`` or ``unknown_field``; the text lists those that exist.
        """
        wanted = self._subscription(request)
        self.leave(peer)
        peer.drop_states()
        robots = tuple(robot for robot in self._robots if robot in wanted.robots)
        peer.send(
            to_protocol.answer(
                m.Subscribed, request, every=request.every, robots=robots, fields=wanted.fields
            )
        )
        if wanted.every:
            self._subscriptions[peer.client.id] = wanted
            latest = map(self._latest.get, robots)
            peer.send_states(*(state.of(wanted.fields) for state in latest if state is not None))

    def leave(self, peer: Peer) -> None:
        """Drop the subscription of a client, and the states that wait for its turn."""
        self._subscriptions.pop(peer.client.id, None)
        self._unsent.pop(peer.client.id, None)

    def _subscription(self, request: m.Subscribe) -> Subscription:
        robots = self._robots if request.robots is None else request.robots
        fields = FIELDS if request.fields is None else request.fields
        _check_known("robot", robots, self._robots, ErrorCode.UNKNOWN_ROBOT)
        _check_known("field", fields, FIELDS, ErrorCode.UNKNOWN_FIELD)
        return Subscription(request.every, frozenset(robots), tuple(f for f in FIELDS if f in fields))

    # --- states -------------------------------------------------------------------------------------------

    def put(self, snapshot: Snapshot) -> None:
        """Keep the states at the ticks of an instant."""
        for observer in self._observers:
            observer(snapshot)
        for tick in snapshot.ticks:
            self._latest[tick.robot] = LatestState(_state(snapshot, tick))

    def publish(self, ticks: Sequence[Tick], peers: Mapping[str, Peer], holders: set[str]) -> None:
        """Send the states at these ticks to the clients that subscribe to them.

        Args:
            ticks: The ticks.
            peers: Sessions by id.
            holders: Ids of the sessions that hold a robot; they are sent states at once.
        """
        for session, peer in tuple(peers.items()):
            if wanted := self._wanted(session, ticks):
                if self._defer is None or session in holders:
                    self._send(peer, _newer(self._unsent.pop(session, {}), wanted))
                else:
                    self._send_later(self._defer, peer, wanted)

    def _wanted(self, session: str, ticks: Sequence[Tick]) -> dict[str, LatestState]:
        """Return the states at these ticks that a session subscribes to, by robot."""
        subscription = self._subscriptions.get(session)
        if subscription is None:
            return {}
        return {
            tick.robot: latest
            for tick in ticks
            if subscription.wants(tick.robot, tick.tick)
            and (latest := self._latest.get(tick.robot)) is not None
        }

    def _send_later(self, defer: Defer, peer: Peer, wanted: dict[str, LatestState]) -> None:
        session = peer.client.id
        waiting = self._unsent.get(session)
        self._unsent[session] = _newer(waiting or {}, wanted)
        if waiting is None:
            defer(peer, lambda: self._send(peer, self._unsent.pop(session, {})))

    def _send(self, peer: Peer, wanted: dict[str, LatestState]) -> None:
        subscription = self._subscriptions.get(peer.client.id)
        if subscription is not None and wanted:
            peer.send_states(*(state.of(subscription.fields) for state in wanted.values()))


def _state(snapshot: Snapshot, tick: Tick) -> m.State:
    # The parts are valid already: validating them again would cost more than the rest of this function.
    fields = {
        "type": "state",
        "re": None,
        "robot": tick.robot,
        "tick": tick.tick,
        "time": tick.time,
        "step": snapshot.step,
        "entries": snapshot.entries,
        "signals": snapshot.signals,
        "warnings": snapshot.warnings,
    }
    return unvalidated(m.State, fields, _BY_THE_WALL_CLOCK if snapshot.step is None else _IN_LOCKSTEP)


def _newer(waiting: dict[str, LatestState], newer: dict[str, LatestState]) -> dict[str, LatestState]:
    """Replace waiting states by newer ones of the same robots; return them in the order of time."""
    return {robot: state for robot, state in waiting.items() if robot not in newer} | newer


def _selected(state: m.State, fields: tuple[str, ...]) -> m.State:
    names = ("robot", "tick", "time", *fields)
    given = set(names)
    entries = tuple([_with(entry, names, given) for entry in state.entries])
    return unvalidated(m.State, {**state.__dict__, "entries": entries}, state.model_fields_set)


def _with(entry: m.Entry, names: tuple[str, ...], given: set[str]) -> m.Entry:
    """Return an entry with these fields only, as a tuple and as a set; the others are absent."""
    values = entry.__dict__
    return unvalidated(m.Entry, {**_ABSENT, **{name: values[name] for name in names}}, given)


def _check_known(what: str, given: Sequence[str], known: Sequence[str], code: ErrorCode) -> None:
    strange = [name for name in given if name not in known]
    if strange:
        text = f"no {what} {', '.join(strange)}; there are {', '.join(known)}"
        raise RemoteProtocolError(code, text, about="subscribe")
