"""Fake server on loopback, made of the protocol's own server side."""

import asyncio
import hashlib
from collections.abc import Callable
from typing import Any

from armgate.protocol import Connection, Refusal, Side
from armgate.protocol import messages as m

URDF = b"<robot name='arm'>" + b" " * 1000 + b"</robot>"
URDF_HASH = hashlib.sha256(URDF).hexdigest()
ORIGIN = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ROBOTS = ("FR", "GR")


def description(**more: Any) -> m.Description:
    robots = tuple(
        m.RobotDescription(
            name=name,
            urdf=m.AssetRef(hash=URDF_HASH, size=len(URDF), media="application/xml"),
            joints=(),
            base_xyz=ORIGIN,
            base_xyzw=UPRIGHT,
            period=0.012,
            start=(0.0, 0.0),
            frames=("tool0",),
            tool="tool0",
            camera=None,
        )
        for name in ROBOTS
    )
    fields: dict[str, Any] = {
        "name": "fake",
        "hash": "0" * 64,
        "stop_distance": 0.05,
        "self_distance": 0.02,
        "response": "stop",
        "lockstep": False,
        "robots": robots,
        "bodies": (),
    }
    return m.Description(**fields | more)


def state(robot: str = "FR", tick: int = 0, **more: Any) -> m.State:
    entries = tuple(
        m.Entry(robot=name, tick=tick, time=0.012 * tick, q=(0.1, 0.2), setpoint=(0.3, 0.4), holder=None)
        for name in ROBOTS
    )
    fields: dict[str, Any] = {"robot": robot, "tick": tick, "time": 0.012 * tick, "entries": entries}
    return m.State(**fields | more)


def verdict(command: m.Command, **more: Any) -> m.Verdict:
    fields: dict[str, Any] = {
        "robot": command.robot,
        "seq": command.seq,
        "tick": command.tick,
        "target": command.tick + 1,
        "outcome": "admitted",
        "beta": 1.0,
        "dq": (0.0, 0.0),
        "setpoint": (0.3, 0.4),
    }
    return m.Verdict(**fields | more)


class FakeConnection(asyncio.Protocol):
    """Connection to the fake server."""

    def __init__(self, server: "FakeServer") -> None:
        self.server = server
        self.protocol = Connection(Side.SERVER)

    def connection_made(self, transport):
        self.transport = transport
        self.server.connections.append(self)

    def data_received(self, data):
        for item in self.protocol.receive(data):
            if isinstance(item, Refusal):
                self.send(item.error)
            else:
                self.server.handle(self, item)

    def connection_lost(self, exc):
        self.server.gone.set()

    def send(self, *messages):
        """Send all messages in one write, so that they arrive together."""
        self.transport.write(b"".join(self.protocol.send(message) for message in messages))


class FakeServer:
    """Server that answers like a daemon; ``on`` replaces the answer to a type of message."""

    def __init__(self):
        self.connections: list[FakeConnection] = []
        self.messages_received: list[m.Message] = []
        self.gone = asyncio.Event()
        self.lockstep = False
        self.ttl = 1.0
        self.fence = 0
        self.first = state(tick=0)
        self.on: dict[type[m.Message], Callable[[FakeConnection, Any], None]] = {}
        self._arrival = asyncio.Event()

    @property
    def newest(self) -> FakeConnection:
        return self.connections[-1]

    def send(self, *messages):
        self.newest.send(*messages)

    def handle(self, connection, message):
        self.messages_received.append(message)
        self._arrival.set()
        self.on.get(type(message), self.answer)(connection, message)

    async def received(self, kind, count=1):
        """Return the newest message of a type, when ``count`` of them have arrived."""
        async with asyncio.timeout(10):
            while len(found := [x for x in self.messages_received if isinstance(x, kind)]) < count:
                self._arrival.clear()
                await self._arrival.wait()
        return found[-1]

    def count(self, kind):
        return sum(isinstance(message, kind) for message in self.messages_received)

    def answer(self, connection, message):
        replies = getattr(self, f"_{message.type}")(message)
        connection.send(*replies)

    def _hello(self, hello):
        limits = m.Limits(
            inbound=65536, outbound=2**20, max_age_ticks=3, lease_ttl=self.ttl, signals=64, signal_rate=200.0
        )
        yield m.Welcome(
            version=1,
            versions=(1,),
            client_versions=hello.versions,
            start="start",
            session="session",
            name=hello.name,
            role=hello.role,
            lockstep=self.lockstep,
            limits=limits,
        )

    def _describe(self, request):
        yield description(re=request.id, lockstep=self.lockstep)

    def _asset(self, request):
        piece = URDF[request.offset : request.offset + min(request.length, 400)]
        yield m.Chunk(re=request.id, hash=request.hash, offset=request.offset, total=len(URDF), data=piece)

    def _acquire(self, request):
        self.fence += 1
        yield self.lease(request, fence=self.fence, state="held", speed=request.speed)

    def _release(self, request):
        yield self.lease(request, fence=request.fence, state="released")

    def lease(self, request, **fields):
        return m.Lease(re=request.id, robot=request.robot, ttl=self.ttl, **fields)

    def lost(self, robot, fence, reason):
        return m.Lease(robot=robot, fence=fence, state="lost", ttl=self.ttl, reason=reason)

    def _subscribe(self, request):
        robots, fields = request.robots or ROBOTS, request.fields or ("q", "setpoint")
        yield m.Subscribed(re=request.id, every=request.every, robots=robots, fields=fields)
        if request.every and self.first is not None:
            yield self.first

    def _command(self, command):
        yield verdict(command)

    def _pass(self, message):
        return ()

    def _signal(self, request):
        yield m.Signaled(re=request.id, name=request.name)

    def _stop(self, request):
        robots = ROBOTS if request.robot is None else (request.robot,)
        yield m.Stopped(re=request.id, stop=7, robots=robots, reason=request.reason, by="me")

    def _reset(self, request):
        yield m.Resumed(re=request.id, stop=request.stop, by="me")

    def _ping(self, request):
        yield m.Pong(re=request.id, time=request.time, received=1.0, sent=1.0)

    def _bye(self, message):
        yield m.Bye()
