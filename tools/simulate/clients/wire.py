"""Raw client: speaks the protocol over a simulated connection, and checks every message that it receives."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any

from armgate.protocol import Connection, LocalProtocolError, Refusal, Side, encode
from armgate.protocol import messages as m
from tools.simulate.findings import Findings

_SETTLED = 1.0
"""Time after which a client that reads has caught up, s."""

_STEPS = 100
"""Steps of lock-step after which a command that has arrived has its verdict.

A client that sends several commands for one tick is ahead: each waits for a further tick of its robot.
"""


def _interrupted(before: m.State, state: m.State) -> bool:
    """Return True if the robot's link was not ready between two states, as far as they show."""
    links = [entry.link for one in (before, state) for entry in one.entries if entry.robot == state.robot]
    return any(link != "ready" for link in links)


class Wire(asyncio.Protocol):
    """Connection of one raw client.

    Args:
        name: Name of the client, for violations.
        findings: Receives violations.
        take: Called with every message.
        granted: Called with every lease that is granted.
        lockstep: True if the daemon runs in lock-step.

    Attributes:
        open: True while the connection is open.
        closed: Set when the connection has ended.
        fences: Fences that this connection was granted, by robot.
        held: Fence of each robot that the client holds, as far as it knows.
        states: Latest state of each robot.
        mangled: True if bytes were sent that are not messages: later messages may be unreadable.
        complete_since: Time since which no state may be missing, s; None if states may be missing.
    """

    def __init__(
        self,
        name: str,
        findings: Findings,
        take: Callable[[m.Message], None],
        granted: Callable[["Wire", m.Lease], None],
        *,
        lockstep: bool,
    ) -> None:
        self._name, self._findings, self._take, self._lockstep = name, findings, take, lockstep
        self._report_granted = granted
        self._connection = Connection(Side.CLIENT)
        self._commands: dict[str, deque[int]] = {}
        self._fence_of: dict[int, int] = {}
        self._pings: dict[float, int] = {}
        self._newest = self._arrived = -1
        self._transport: Any = None
        self._ids = 0
        self._asked: dict[int, str] = {}
        self.open, self.closed = False, asyncio.Event()
        self.fences: dict[str, set[int]] = {}
        self.held: dict[str, int] = {}
        self.states: dict[str, m.State] = {}
        self.stops: dict[int, m.Stopped] = {}
        self.welcomed = False
        self.got: dict[str, int] = {}
        self.mangled = False
        self._expected: dict[int, int] = {}
        self._every: dict[str, int] = {}
        self.complete_since: float | None = None

    # --- sending --------------------------------------------------------------------------------------------

    def send(self, message: m.Message) -> None:
        """Send a message, if the connection is open."""
        if not self.open:
            return
        if isinstance(message, m.Command):
            self._commands.setdefault(message.robot, deque()).append(message.seq)
            self._newest = message.seq
            self._fence_of[message.seq] = message.fence
        if isinstance(message, m.Ping):
            self._pings[message.time] = self._newest
        try:
            data = self._connection.send(message)
        except LocalProtocolError:  # a malicious client sends it anyway
            data = encode(message)
        self.send_bytes(data)

    def ask(self, message: m.Request) -> int:
        """Send a request with an id; return the id."""
        self._ids += 1
        self._asked[self._ids] = message.type
        self.send(message.model_copy(update={"id": self._ids}))
        return self._ids

    def send_bytes(self, data: bytes) -> None:
        """Send bytes."""
        if self.open:
            self._transport.write(data)

    def mangle(self, data: bytes) -> None:
        """Send bytes that are not messages."""
        self.mangled = True
        self.send_bytes(data)

    def pause(self) -> None:
        """Stop reading."""
        self.complete_since = None
        if self.open:
            self._transport.pause_reading()

    def resume(self) -> None:
        """Read again."""
        if self.open:
            self._transport.resume_reading()

    def close(self) -> None:
        """Close the connection."""
        if self.open:
            self._transport.close()

    def abort(self) -> None:
        """Close the connection at once."""
        if self.open:
            self._transport.abort()

    @property
    def unanswered(self) -> int:
        """Number of commands without a verdict."""
        return sum(map(len, self._commands.values()))

    # --- asyncio --------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport, self.open = transport, True
        self._other_end: Any = transport.get_extra_info("socket")._sock.peer

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the end."""
        self.open = False
        self.closed.set()

    def data_received(self, data: bytes) -> None:
        """Decode and check messages."""
        for item in self._connection.receive(data):
            if isinstance(item, Refusal):
                self._findings.report("readable messages", f"{self._name}: {item.error}")
            else:
                self._receive(item)

    def eof_received(self) -> bool:
        """Close, too."""
        return False

    # --- checks ---------------------------------------------------------------------------------------------

    def _receive(self, message: m.Message) -> None:
        self.got[message.type] = self.got.get(message.type, 0) + 1
        re = getattr(message, "re", None)
        if re is not None:
            self._check(self._asked.pop(re, None) is not None, "one answer per request", message)
        match message:
            case m.Welcome():
                self._check(not self.welcomed, "one welcome", message)
                self.welcomed = True
            case m.Verdict():
                self._verdict(message)
            case m.State():
                self._state(message)
            case m.Lease():
                self._lease(message)
            case m.Subscribed():
                self._every = dict.fromkeys(message.robots, message.every)
            case m.Pong():
                self._pong(message)
            case m.Stopped():
                self._stopped(message)
            case m.Resumed():
                self.stops.pop(message.stop, None)
                self.stops.pop(-1 if message.lifted is None else message.lifted, None)
            case m.Error():
                self._error(message)
            case _:
                pass
        self._take(message)

    def _verdict(self, verdict: m.Verdict) -> None:
        if self.mangled:
            return
        waiting = self._commands.get(verdict.robot, deque())
        expected = waiting.popleft() if waiting else None
        self._check(expected == verdict.seq, "one verdict per command, in order", (expected, verdict))
        fence = self._fence_of.pop(verdict.seq, None)
        if verdict.outcome != "refused":
            granted = fence in self.fences.get(verdict.robot, ())
            self._check(granted, "commands need the lease", (fence, verdict))

    def _error(self, error: m.Error) -> None:
        if error.seq is not None:
            for waiting in self._commands.values():
                if waiting and error.seq in waiting:
                    waiting.remove(error.seq)
                    return

    def _state(self, state: m.State) -> None:
        before = self.states.get(state.robot)
        newer = before is None or state.tick > before.tick
        # A new subscription sends the latest state again.
        again = before is not None and state.tick == before.tick and self.got.get("subscribed", 0) > 1
        self._check(newer or again, "states are monotonic", (before and before.tick, state.robot, state.tick))
        if before is not None:
            ticks = {entry.robot: entry.tick for entry in state.entries}
            for one in before.entries:
                later = ticks.get(one.robot, -1)
                self._check(later >= one.tick, "entries are monotonic", (one.robot, one.tick, later))
        every = self._every.get(state.robot)
        complete = self.complete_since is not None and state.tick > 0
        if complete and every and before is not None and newer and not again:
            now = asyncio.get_running_loop().time()
            if now > (self.complete_since or now) + _SETTLED and not _interrupted(before, state):
                gap = (before.tick, state.tick, every, state.robot)
                self._check(state.tick == before.tick + every, "states are complete", gap)
        self.states[state.robot] = state
        if state.step is not None:
            self._expected[state.step] = self._arrived
            if (newest := self._expected.pop(state.step - _STEPS, None)) is not None:
                self._check_answered(newest, ("step", state.step))

    def _lease(self, lease: m.Lease) -> None:
        known = self.fences.setdefault(lease.robot, set())
        if lease.state == "held":
            self._check(all(lease.fence > other for other in known), "fences grow", (lease, known))
            known.add(lease.fence)
            self.held[lease.robot] = lease.fence
            self._report_granted(self, lease)
        else:
            self._check(lease.fence in known, "leases end once granted", (lease, known))
            if self.held.get(lease.robot) == lease.fence:
                del self.held[lease.robot]

    @property
    def silent_since(self) -> int:
        """Time at which data of this client last arrived at the daemon, ns."""
        return int(self._other_end.received_at)

    @property
    def daemon(self) -> Any:
        """Process of the daemon."""
        return self._other_end.process

    def _stopped(self, stopped: m.Stopped) -> None:
        if stopped.replaces is not None:
            self.stops.pop(stopped.replaces, None)
        self.stops[stopped.stop] = stopped

    def _pong(self, pong: m.Pong) -> None:
        """Check that a pong has a ping, and by the wall clock that all commands before it have verdicts."""
        if self.mangled:
            return
        newest = self._pings.pop(pong.time, None)
        self._check(newest is not None, "one pong per ping", pong)
        if newest is not None:
            self._arrived = max(newest, self._arrived)
        if not self._lockstep:
            self._check_answered(self._arrived, pong)

    def _check_answered(self, newest: int, seen: object) -> None:
        """Check that all commands up to a number have their verdicts."""
        late = [seq for seqs in self._commands.values() for seq in seqs if seq <= newest]
        self._check(not late, "a verdict for each command", (seen, late))

    def _check(self, holds: bool, invariant: str, seen: object) -> None:
        if not holds:
            self._findings.report(invariant, f"{self._name}: {seen}")
