"""Random sessions of clients in lock-step: run in a world, then repeated over the sockets of a daemon."""

import asyncio
import contextlib
from dataclasses import dataclass

from armgate.protocol import VERSIONS, Connection, RemoteProtocolError, Side, encode
from armgate.protocol import messages as m
from support.clients import PATIENCE

PARTICIPANTS = ("a", "b")
ROLES = ("controller", "operator")
AHEAD = 200
"""Largest number of messages of a participant that wait for later steps, less one: a daemon allows 256."""


@dataclass(frozen=True)
class Join:
    """A connection with its hello; connections are numbered in this order."""

    name: str
    role: str


@dataclass(frozen=True)
class Send:
    """A message on a connection, and whether a ping follows: the pong shows that it was processed."""

    connection: int
    message: m.Message
    ping: m.Ping | None


@dataclass(frozen=True)
class Leave:
    """The bye of a connection."""

    connection: int


class RandomSessions:
    """Random sessions of two participants and an observer in a world.

    Attributes:
        actions: What the clients did, in order.
        received: Encoded messages of each connection.
        kinds: Types of the messages, outcomes and causes of verdicts, states of leases, and codes of errors.
    """

    def __init__(self, world, rng):
        self.world, self.rng = world, rng
        self.periods = {robot.name: robot.period for robot in world.cell.robots}
        self.joints = {robot.name: robot.model.n for robot in world.cell.robots}
        self.actions, self.received, self.kinds = [], [], set()
        self.open = {}
        self.fences, self.stops = {}, []
        self.seq = self.pings = 0
        self.order = rng.choice((0.9, 0.9, 0.3))  # how often a participant speaks that is not done yet
        self.spoke = -1, set()  # number of a step, and the connections that commanded or passed in it

    def run(self, count):
        """Let clients do a number of things."""
        for _ in range(count):
            self._act()
            self._settle()
        for number in list(self.open):  # the pongs show that all messages before have arrived
            self._send(number, m.Ping(time=3.0))
            self._settle()
        return self

    def _settle(self):
        """End the steps that a daemon would end, and take the messages of all clients."""
        while self.world.complete:
            self.world.step()
        self._take()

    def _act(self):
        missing = [name for name in (*PARTICIPANTS, "eye") if name not in self._names()]
        if missing and self.rng.random() < 0.5:
            self._join(self.rng.choice(missing))
        elif self.rng.random() < 0.005:
            self._join(self.rng.choice(PARTICIPANTS))  # refused if it is connected
        elif self.open:
            number = self._speaker()
            if self.rng.random() < 0.005:
                self._leave(number)
            elif not self._is_far_ahead(self.open[number]):
                self._send(number, self._message(self.open[number]))

    def _speaker(self):
        """Return a connection, mostly one that has not commanded or passed in this step."""
        if self.world.number != self.spoke[0]:
            self.spoke = self.world.number, set()
        participants = [number for number, client in self.open.items() if client.name in PARTICIPANTS]
        quiet = [number for number in participants if number not in self.spoke[1]]
        return self.rng.choice(quiet if quiet and self.rng.random() < self.order else list(self.open))

    def _is_far_ahead(self, client):
        return client.name in PARTICIPANTS and len(self.world._lockstep._ahead[client.name]) > AHEAD

    def _names(self):
        return [client.name for client in self.open.values()]

    def _join(self, name):
        role = "observer" if name == "eye" and self.rng.random() < 0.3 else self.rng.choice(ROLES)
        self.actions.append(Join(name, role))
        self.received.append([])
        number = len(self.received) - 1
        try:
            client = self.world.join(name, role)
        except RemoteProtocolError as error:
            self.received[number].append(encode(error.message()))
            self.kinds.add(str(error.code))
        else:
            self.received[number].append(encode(client.welcome))
            self.open[number] = client

    def _leave(self, number):
        self.actions.append(Leave(number))
        self.open[number].leave()

    def _send(self, number, message):
        client = self.open[number]
        client.send(message)
        while self.world.complete:
            self.world.step()
        ping = None
        if not client.ended:
            self.pings += 1
            ping = m.Ping(id=1_000_000 + self.pings, time=0.0)
            client.send(ping)
        self.actions.append(Send(number, message, ping))
        if isinstance(message, m.Command | m.Pass):
            self.spoke[1].add(number)

    def _take(self):
        for number, client in list(self.open.items()):
            for message in client.take():
                self.received[number].append(encode(message))
                self._note(client, message)
            if client.ended:
                del self.open[number]

    def _note(self, client, message):
        self.kinds.add(message.type)
        match message:
            case m.Verdict():
                self.kinds |= {message.outcome, *(reason.cause for reason in message.reasons)}
            case m.Error():
                self.kinds.add(message.code)
            case m.Lease(state="held"):
                self.kinds.add("held")
                self.fences[client.name, message.robot] = message.fence
            case m.Lease():
                self.kinds.add(message.state)
                self.fences.pop((client.name, message.robot), None)
            case m.Stopped():
                self.stops.append(message.stop)

    # --- messages -----------------------------------------------------------------------------------------

    def _message(self, client):
        rng = self.rng
        held = [robot for name, robot in self.fences if name == client.name]
        if client.name in PARTICIPANTS and rng.random() < 0.85:
            if held and rng.random() < 0.9:
                return self._command(client, rng.choice(held))
            return m.Acquire(robot=self._robot()) if rng.random() < 0.6 else m.Pass(step=self.world.number)
        weights, makers = zip(*self._others(client), strict=True)
        return rng.choices(makers, weights)[0]()

    def _robot(self):
        return "Z" if self.rng.random() < 0.03 else self.rng.choice(tuple(self.periods))

    def _command(self, client, robot, wrong=0.1):
        rng = self.rng
        self.seq += 1
        fence = self.fences.get((client.name, robot), 1) + (rng.random() < wrong / 2)
        tick = round(self.world.time / self.periods.get(robot, 1.0))
        if rng.random() < wrong:
            tick = max(0, tick - rng.randint(1, 9))
        size = rng.choice((0.0, 1e-4, 1e-3, 1e-2, 1e308 if rng.random() < wrong else 1e-3))
        joints = self.joints.get(robot, 3) - (rng.random() < wrong / 2)
        dq = tuple(rng.uniform(-size, size) for _ in range(joints))
        return m.Command(robot=robot, fence=fence, seq=self.seq, tick=tick, dq=dq)

    def _others(self, client):
        rng, some_id = self.rng, self.rng.choice((None, 1, 2))
        robots = tuple(self.periods)
        return (
            (4, lambda: self._command(client, self._robot(), wrong=0.5)),
            (4, lambda: m.Subscribe(
                id=some_id, every=rng.choice((0, 1, 1, 3)), robots=rng.choice((None, robots, ("A",), ("Z",))),
                fields=rng.choice((None, ("q",), ("verdict", "stops"), ())),
            )),
            (4, lambda: m.Signal(id=some_id, name=rng.choice(("x", "y", "operator.z")), value=(1.0,))),
            (4, lambda: m.Acquire(id=some_id, robot=self._robot(), takeover=rng.random() < 0.3, speed=0.5)),
            (3, lambda: m.Release(robot=self._robot(), fence=self.fences.get((client.name, "A"), 1))),
            (0.5, lambda: m.Stop(id=some_id, reason="enough", robot=rng.choice((None, *robots)))),
            (8, lambda: m.Reset(id=some_id, stop=self.stops[-1] if self.stops else 1)),
            (2, lambda: m.Reset(id=some_id, stop=rng.randint(1, 5))),
            (2, lambda: m.Pass(step=max(0, self.world.number + rng.choice((0, 0, 1, -1))))),
            (1, lambda: m.Ping(time=1.0)),
            (1, lambda: m.Describe(id=some_id)),
            (0.5, lambda: m.Kick(id=some_id, session=rng.choice(("p0", "p1", "s3", *["s99"] * 9)))),
        )  # fmt: skip


class Wire:
    """Connection to a daemon, read all the time: an observer that reads slowly would miss states."""

    def __init__(self, reader, writer):
        self.writer = writer
        self.connection = Connection(Side.CLIENT)
        self.raw = bytearray()
        self.messages = []
        self.changed = asyncio.Condition()
        self.ended = False
        self.task = asyncio.create_task(self._read(reader))

    @classmethod
    async def open(cls, port):
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    async def _read(self, reader):
        while data := await reader.read(65536):
            self.raw += data
            async with self.changed:
                self.messages += self.connection.receive(data)
                self.changed.notify_all()
        async with self.changed:
            self.ended = True
            self.changed.notify_all()

    def send(self, message):
        self.writer.write(self.connection.send(message))

    async def wait(self, condition):
        """Wait until a condition holds, or the daemon has closed the connection."""
        async with asyncio.timeout(PATIENCE), self.changed:
            await self.changed.wait_for(lambda: self.ended or condition())

    async def close(self):
        self.writer.close()
        with contextlib.suppress(OSError):
            await self.writer.wait_closed()
        await self.task


async def repeat(port, actions):
    """Do the same over the sockets of a daemon; return the bytes that each connection received."""
    wires = []
    for action in actions:
        match action:
            case Join(name, role):
                wires.append(wire := await Wire.open(port))
                wire.send(m.Hello(versions=VERSIONS, name=name, role=role))
                await wire.wait(lambda wire=wire: wire.messages)
                if isinstance(wire.messages[0], m.Error):
                    await _end(wire, wires)
            case Send(connection, message, None):
                wires[connection].send(message)
                await _end(wires[connection], wires)
            case Send(connection, message, ping):
                wire = wires[connection]
                wire.send(message)
                wire.send(ping)
                await wire.wait(lambda wire=wire, ping=ping: _has_pong(wire, ping))
            case Leave(connection):
                wires[connection].send(m.Bye())
                await _end(wires[connection], wires)
    received = [bytes(wire.raw) for wire in wires]  # closing one lets the steps of the others end
    for wire in wires:
        await wire.close()
    return received


def _has_pong(wire, ping):
    return any(isinstance(message, m.Pong) and message.re == ping.id for message in wire.messages[-64:])


async def _end(wire, wires):
    """Wait for the end of a connection, close it, and let the daemon notice that."""
    await wire.wait(lambda: False)
    await wire.close()
