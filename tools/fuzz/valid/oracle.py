"""Checks of everything that one client receives against the specification."""

from collections import defaultdict, deque
from dataclasses import dataclass, field

from armgate.protocol import messages as m
from armgate.protocol.codec import MAX_STR


class ViolationError(AssertionError):
    """Violation of the specification by the server."""


def require(condition: bool, otherwise: str) -> None:
    """Raise ViolationError unless a condition holds."""
    if not condition:
        raise ViolationError(otherwise)


@dataclass
class Knowledge:
    """Knowledge of a client about its cell.

    Attributes:
        robots: Names of the cell's robots.
        joints: Number of joints by robot.
        fences: Fences of the held leases by robot.
        ticks: Newest tick by robot in a state.
        step: Newest step in lock-step.
        in_force: Stops in the newest state.
        stops_seen: Ids of the newest stops that the client was notified of.
        assets: Hashes in the description.
        chosen: Robot of the next message.
    """

    robots: tuple[str, ...]
    joints: dict[str, int]
    fences: dict[str, int] = field(default_factory=dict)
    ticks: dict[str, int] = field(default_factory=dict)
    step: int = 0
    in_force: set[int] = field(default_factory=set)
    stops_seen: deque[int] = field(default_factory=lambda: deque(maxlen=100))
    assets: tuple[str, ...] = ()
    chosen: str = ""


class Expectations:
    """Expectations of one client, from the messages that it sent and received.

    Args:
        known: Knowledge of the client; updated with every message.
        exact: True if a state arrives as soon as it is made, so that it must agree with all earlier messages.

    Attributes:
        ended: True after ``bye`` or a fatal error.
        stops: Robots by id of the stops in force that this client was notified of.
    """

    def __init__(self, known: Knowledge, *, exact: bool) -> None:
        self.known = known
        self.ended = False
        self._exact = exact
        self._asked: dict[int, m.Request] = {}
        self._commands: dict[str, deque[m.Command]] = defaultdict(deque)
        self._subscribed: m.Subscribed | None = None
        self._fresh: set[str] = set()
        self._last: dict[str, int] = {}
        self._newest_stop = 0
        self._time = 0.0
        self._fences: dict[str, int] = {}
        self.stops: dict[int, tuple[str, ...]] = {}

    def note_sent(self, message: m.Message) -> None:
        """Note a message that the client sends."""
        if isinstance(message, m.Request):
            if message.id is not None:
                self._asked[message.id] = message
        elif isinstance(message, m.Command):
            self._commands[message.robot].append(message)

    @property
    def waiting(self) -> bool:
        """True while an answer or a verdict is due."""
        return bool(self._asked) or any(self._commands.values())

    def check(self, message: m.Message) -> None:
        """Check a message of the server against the specification.

        Raises:
            ViolationError: The message violates the specification.
        """
        require(not self.ended, f"{message.type} after the end")
        if isinstance(message, m.Answer):
            self._answer(message)
        match message:
            case m.Verdict():
                self._verdict(message)
            case m.State():
                self._state(message)
            case m.Lease():
                self._lease(message)
            case m.Stopped():
                self._stopped(message)
            case m.Resumed():
                self._resumed(message)
            case m.Error():
                self._error(message)
            case m.Subscribed():
                self._subscribed = message if message.every else None
                self._last.clear()
                self._fresh = set(message.robots)
            case m.Description():
                self.known.assets = tuple(robot.urdf.hash for robot in message.robots)
            case m.Bye():
                self.ended = True
            case _:
                pass

    # --- answers ------------------------------------------------------------------------------------------

    def _answer(self, message: m.Answer) -> None:
        if message.re is None:
            return
        request = self._asked.pop(message.re, None)
        require(
            request is not None,
            f"{message.type} with re {message.re}, not requested or already answered",
        )
        assert request is not None
        if not isinstance(message, m.Error):
            expected = m.ANSWERS[type(request)]
            require(type(message) is expected, f"{request.type} was answered by {message.type}")
        if isinstance(request, m.Ping) and isinstance(message, m.Pong):
            require(repr(message.time) == repr(request.time), f"ping {request.time!r}, pong {message.time!r}")

    def _error(self, error: m.Error) -> None:
        require(len(error.text.encode()) <= MAX_STR, "the text of an error is too long")
        require(error.code != "internal", f"the server failed: {error.text}")
        require(
            error.code not in ("malformed", "invalid_message"), f"a valid message was refused: {error.text}"
        )
        self.ended = error.fatal
        if error.about == "command" and error.seq is not None and not error.fatal:
            found = [r for r, waiting in self._commands.items() if waiting and waiting[0].seq == error.seq]
            unknown = [r for r in found if r not in self.known.robots]
            require(bool(unknown), f"a command for a robot of the cell got {error.code}")
            self._commands[unknown[0]].popleft()

    def _verdict(self, verdict: m.Verdict) -> None:
        waiting = self._commands.get(verdict.robot)
        require(bool(waiting), f"a verdict of {verdict.robot} without a command")
        assert waiting is not None
        command = waiting.popleft()
        same = (verdict.seq, verdict.tick) == (command.seq, command.tick)
        require(same, f"the verdict on seq {verdict.seq} precedes that on {command.seq}")
        n = self.known.joints[verdict.robot]
        require(
            len(verdict.dq) == len(verdict.setpoint) == n, "dq or setpoint of a verdict has a wrong length"
        )
        require(
            (verdict.outcome == "admitted") == (not verdict.reasons),
            "admitted with a reason, or not admitted without a reason",
        )
        require(
            (verdict.beta > 0.0) == (verdict.outcome != "refused"), f"{verdict.outcome} with {verdict.beta}"
        )

    # --- states -------------------------------------------------------------------------------------------

    def _state(self, state: m.State) -> None:
        wanted = self._subscribed
        require(wanted is not None, "a state without a subscription")
        assert wanted is not None
        robot, first = state.robot, state.robot in self._fresh
        require(robot in wanted.robots, f"a state of {robot}, which was not subscribed")
        require(
            first or state.tick % wanted.every == 0, f"a state at tick {state.tick} of every {wanted.every}"
        )
        require(state.tick > self._last.get(robot, -1), f"tick {state.tick} of {robot} does not ascend")
        require(
            first or state.time >= self._time, f"the state at {state.time} s follows one at {self._time} s"
        )
        self._time = max(self._time, state.time)
        self._fresh.discard(robot)
        self._last[robot] = self.known.ticks[robot] = state.tick
        self.known.step = self.known.step if state.step is None else state.step
        names = [entry.robot for entry in state.entries]
        require(names == [name for name in self.known.robots if name in names], f"entries of {names}")
        self.known.in_force = {stop for entry in state.entries for stop in entry.stops or ()}
        for entry in state.entries:
            self._entry(entry, wanted, first)

    def _entry(self, entry: m.Entry, wanted: m.Subscribed, first: bool) -> None:
        given = entry.model_fields_set - {"robot", "tick", "time"}
        require(given == set(wanted.fields), f"an entry has {sorted(given)} of {wanted.fields}")
        n = self.known.joints[entry.robot]
        for name in ("q", "setpoint", "stop_end"):
            if name in given:
                require(
                    len(getattr(entry, name)) == n, f"{name} of {entry.robot} has another length than {n}"
                )
        if "stops" in given and self._exact and not first:
            mine = tuple(sorted(id_ for id_, robots in self.stops.items() if entry.robot in robots))
            shown = tuple(stop for stop in entry.stops or () if stop in self.stops or stop > self._oldest)
            require(shown == mine, f"{entry.robot} shows the stops {entry.stops}; expected {mine}")

    # --- leases and stops ---------------------------------------------------------------------------------

    def _lease(self, lease: m.Lease) -> None:
        robot, held = lease.robot, self.known.fences
        if lease.state == "held":
            require(
                lease.fence > self._fences.get(robot, -1), f"fence {lease.fence} of {robot} does not grow"
            )
            held[robot] = self._fences[robot] = lease.fence
        else:
            require(held.get(robot) == lease.fence, f"lease of {robot} {lease.state}, which was not held")
            del held[robot]

    def _stopped(self, stopped: m.Stopped) -> None:
        require(stopped.stop > self._newest_stop, f"stop {stopped.stop} after {self._newest_stop}")
        self._newest_stop = stopped.stop
        if not self.known.stops_seen:
            self._oldest = stopped.stop - 1
        self.known.stops_seen.append(stopped.stop)
        if stopped.replaces is not None:
            self.stops.pop(stopped.replaces, None)
        self.stops[stopped.stop] = stopped.robots

    def _resumed(self, resumed: m.Resumed) -> None:
        lifted = resumed.stop if resumed.lifted is None else resumed.lifted
        require(
            self.stops.pop(lifted, None) is not None or lifted <= self._oldest,
            f"stop {lifted} was not in force",
        )

    _oldest = 2**63
    """Largest id of a stop that may be older than this client."""
