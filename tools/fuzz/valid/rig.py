"""Core with its gate, emulated robots and clients in memory; every message passes through the codec."""

import io
import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from random import Random

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import LockstepClockConfig
from armgate.emulator import VirtualClock
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.links.log import Log
from armgate.protocol import (
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    Connection,
    Refusal,
    RemoteProtocolError,
    Side,
    encode,
)
from armgate.protocol import messages as m
from armgate.world.core import Core
from armgate.world.gate_runner import GateRunner
from armgate.world.interfaces import Batch, ClientRequest, Encoded
from armgate.world.interfaces import Client as CoreClient
from armgate.world.lease_changes import LeaseTime
from armgate.world.lockstep import Lockstep
from armgate.world.rights import RIGHTS
from armgate.world.to_protocol import answer
from tools.fuzz.valid import cells
from tools.fuzz.valid.generator import MessageGenerator
from tools.fuzz.valid.oracle import Expectations, Knowledge, ViolationError, require

_ROLES: tuple[m.Role, ...] = ("observer", "controller", "operator")
_CLIENTS = 6
_TICK = 0.04
"""Probability that a tick of the robots that are due follows a message."""

_LEAVE = 0.002
_EARLY = 0.02
"""Probability that a client sends another message before its hello."""


class Client:
    """Client, and the server's end of its connection."""

    def __init__(self, rig: "Rig", number: int, name: str, role: m.Role) -> None:
        self.name = name
        self.role: m.Role = role
        self.client = CoreClient("", name, role, identity="memory", address="memory")
        self.expects = Expectations(rig.knowledge(), exact=True)
        self.generator = MessageGenerator(rig.rng, self.expects.known).only(rig.types)
        self.gone = False
        self._rig, self._number = rig, number
        self._here, self._there = Connection(Side.CLIENT), Connection(Side.SERVER)

    # --- the server's end, which implements `Peer` --------------------------------------------------------

    def identify(self, session: str) -> None:
        """Set the id of the session."""
        self.client = replace(self.client, id=session)

    def send(self, message: m.Message, frame: bytes | None = None) -> None:
        """Send a message to the client, which checks it against the specification at once."""
        if not self.gone:
            self._deliver(self._there.send(message, frame))

    def send_states(self, *states: Encoded) -> None:
        """Send states."""
        for state in states:
            if not self.gone:
                self._deliver(self._there.send(state.state, state.frame))

    def batch(self) -> Batch:
        """Return a batch without buffering: messages in memory are delivered at once."""
        return NoBatch()

    def keep_states(self) -> None:
        """Do nothing: every state is delivered at once."""

    def drop_states(self) -> None:
        """Do nothing."""

    def close(self, message: m.Message) -> None:
        """Send a last message; the session has ended."""
        self.send(message)
        self.gone = True

    def expel(self, error: RemoteProtocolError) -> None:
        """End the session on behalf of an operator."""
        if not self.gone:
            self.close(error.message())
            self._rig.leave(self)

    def _deliver(self, frame: bytes) -> None:
        for item in self._here.receive(frame):
            if isinstance(item, Refusal):
                raise ViolationError(f"the server sent an invalid message: {item}")
            self.expects.check(item)

    # --- the client's end ---------------------------------------------------------------------------------

    def request(self, message: m.Message) -> None:
        """Send a message to the server, which acts on it at once."""
        self.expects.note_sent(message)
        for item in self._there.receive(self._here.send(message)):
            if isinstance(item, Refusal):
                raise ViolationError(f"a valid message was refused: {item}")
            self._rig.handle_message(self, item)

    def send_before_hello(self, message: m.Message) -> None:
        """Send another message before hello; the server must answer with a fatal error."""
        (item,) = self._there.receive(encode(message))
        require(isinstance(item, Refusal) and item.error.code == "unexpected", f"before hello: {item}")
        self.gone = True

    def join(self) -> None:
        """Send hello."""
        self.request(m.Hello(id=0, versions=(1,), name=self.name, role=self.role))

    @property
    def number(self) -> int:
        """Number of the connection."""
        return self._number


class NoBatch:
    """Batch without buffering."""

    def close(self) -> None:
        """Do nothing."""

    def flush(self) -> None:
        """Do nothing."""

    def __enter__(self) -> "NoBatch":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SteppedWallClock:
    """Pace of a daemon by the wall clock, whose time the search advances."""

    def __init__(self, periods: list[float], handler: "Rig") -> None:
        self._clock = VirtualClock(periods)
        self._handler = handler
        self.time = 0.0

    def tick(self) -> None:
        """Advance to the next instant at which robots tick."""
        instant = self._clock.advance()
        self.time = instant.time
        self._handler.due(instant.time, instant.due, None)


class Rig:
    """Cell and its clients.

    Args:
        folder: Folder for the cell's files.
        rng: Source of all choices.
        robots: Number of robots.
        joints: Largest number of joints of a robot.
        lockstep: Run in lock-step instead of by the wall clock.
    """

    types = frozenset(RIGHTS)
    """Types of messages that the core handles."""

    def __init__(self, folder: Path, rng: Random, robots: int, joints: int, *, lockstep: bool) -> None:
        self.rng = rng
        self.lockstep = lockstep
        self.cell: Cell = build_cell(cells.make(folder, rng, robots, joints, lockstep=lockstep))
        self.links = [
            EmulatedLink(r.name, "s", r.start.tolist(), r.period, r.config.link.lag) for r in self.cell.robots
        ]
        self.gate = Gate(self.cell, "s")
        runner = GateRunner(self.gate, {link.robot: link for link in self.links})
        periods = [robot.period for robot in self.cell.robots]
        log = Log(io.StringIO())
        clock = self.cell.config.clock
        if isinstance(clock, LockstepClockConfig):
            self.pace: Lockstep | SteppedWallClock = Lockstep(
                periods, clock.participants, 1e9, log, lambda: 0.0
            )
        else:
            self.pace = SteppedWallClock(periods, self)
        lease_time = (lambda: LeaseTime(0.0, 0.0)) if lockstep else None
        self.core = Core(
            self.cell, runner, self.links, self._now, log, lockstep=lockstep, lease_time=lease_time
        )
        self.clients: list[Client] = []
        self._numbers = itertools.count(1)
        if isinstance(self.pace, Lockstep):
            self.pace.start(self.core, self.due)
        else:
            self.core.start()
            self.pace.tick()

    def knowledge(self) -> Knowledge:
        """Return the knowledge of a new client."""
        return Knowledge(self.core.robots, {robot.name: robot.model.n for robot in self.cell.robots})

    def run(self, messages: int) -> None:
        """Send this number of messages, then reset all stops and acquire every robot.

        Raises:
            ViolationError: The server violated the specification.
        """
        for _ in range(messages):
            self._send_one()
        self._recover()

    def due(self, time: float, robots: Sequence[int], step: int | None) -> None:
        """Let some robots tick."""
        self.core.tick([self.links[index].advance(time) for index in robots], step)

    def handle_message(self, client: Client, message: m.Message) -> None:
        """Handle a message like the daemon."""
        match message:
            case m.Hello():
                self._welcome(client, message)
            case m.Bye():
                self.leave(client)
                client.send(m.Bye())
            case _ if not isinstance(message, ClientRequest):
                raise ViolationError(f"{message.type} is not a message of a client")
            case _ if isinstance(self.pace, Lockstep):
                self.pace.handle(client, message)
            case _:
                self.core.handle(client, message)
                require(not client.expects.waiting, f"{message.type} was not answered at once")

    # --- inside -------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return self.pace.now() if isinstance(self.pace, Lockstep) else self.pace.time

    def _send_one(self) -> None:
        self.clients = [client for client in self.clients if not client.gone]
        if len(self.clients) < _CLIENTS and (not self.clients or self.rng.random() < 0.1):
            self._connect()
            return
        client = self.rng.choice(self.clients)
        if self.rng.random() < _LEAVE:
            client.request(m.Bye(reason="x" * self.rng.choice((0, 512))))
            client.gone = True
            self._closed(client)
            return
        client.request(client.generator.next())
        if isinstance(self.pace, SteppedWallClock) and self.rng.random() < _TICK:
            self.pace.tick()

    def _connect(self, name: str | None = None, role: m.Role | None = None) -> Client:
        free = [one for one in cells.PARTICIPANTS if all(one != client.name for client in self.clients)]
        name = name or (self.rng.choice(free) if free and self.lockstep else self.rng.choice("abc"))
        client = Client(self, next(self._numbers), name, self.rng.choice(_ROLES) if role is None else role)
        if self.rng.random() < _EARLY:
            client.send_before_hello(client.generator.next())
            return client
        client.join()
        if not client.gone:
            self.clients.append(client)
        return client

    def _welcome(self, client: Client, hello: m.Hello) -> None:
        if isinstance(self.pace, Lockstep):
            client.identify(self.pace.session_id(client.name, client.number))
        else:
            client.identify(f"s{client.number}")
        try:
            if isinstance(self.pace, Lockstep):
                self.pace.join(client)
            else:
                self.core.join(client)
        except RemoteProtocolError as error:
            error.re = hello.id
            client.close(error.message())
            return
        client.send(self._greeting(client, hello))

    def _greeting(self, client: Client, hello: m.Hello) -> m.Welcome:
        limits = m.Limits(
            inbound=INBOUND_LIMIT, outbound=OUTBOUND_LIMIT, max_age_ticks=3, lease_ttl=1.0, signals=64,
            signal_rate=1.0,
        )  # fmt: skip
        return answer(
            m.Welcome, hello, version=1, versions=(1,), client_versions=hello.versions, start="s",
            session=client.client.id, name=client.name, role=client.role, lockstep=self.lockstep,
            limits=limits,
        )  # fmt: skip

    def leave(self, client: Client) -> None:
        """End the session of a client."""
        if isinstance(self.pace, Lockstep):
            self.pace.leave(client)
        else:
            self.core.leave(client)

    def _closed(self, client: Client) -> None:
        if not self.lockstep:
            require(client.client.id not in self.core.peers, "a session still exists after its bye")

    def _recover(self) -> None:
        """Reset every stop and acquire every robot, which shows that the server still works."""
        self._disconnect_all()
        operator = self._connect_surely("op", "operator")
        if isinstance(self.pace, Lockstep):
            return  # in lock-step, time advances only with the participants
        assert isinstance(self.pace, SteppedWallClock)
        for _ in range(400):
            self.pace.tick()
        operator.request(m.Subscribe(fields=("stops",)))
        stops = {stop for robot in self.core.robots for stop in self.gate.view(robot).stops}
        for stop in sorted(stops):
            operator.request(m.Reset(id=stop, stop=stop))
        left = {robot: self.gate.view(robot).stops for robot in self.core.robots}
        require(not any(left.values()), f"stops cannot be reset: {left}")
        for number, robot in enumerate(self.core.robots):
            operator.request(m.Acquire(id=2**30 + number, robot=robot))
        require(set(operator.expects.known.fences) == set(self.core.robots), "a robot cannot be acquired")

    def _disconnect_all(self) -> None:
        for client in self.clients:
            if not client.gone:
                client.request(m.Bye())
                client.gone = True
        self.clients = []

    def _connect_surely(self, name: str, role: m.Role) -> Client:
        while (client := self._connect(name, role)).gone:
            pass
        return client
