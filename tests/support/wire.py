"""A server on loopback made of the protocol's own server side."""

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


class Seat(asyncio.Protocol):
    """One connection to the fake server."""

    def __init__(self, server: "Server") -> None:
        self.server = server
        self.connection = Connection(Side.SERVER)

    def connection_made(self, transport):
        self.transport = transport
        self.server.seats.append(self)

    def data_received(self, data):
        for item in self.connection.receive(data):
            if isinstance(item, Refusal):
                self.say(item.error)
            else:
                self.server.take(self, item)

    def connection_lost(self, exc):
        self.server.gone.set()

    def say(self, *messages):
        """All in one write, so that they arrive together."""
        self.transport.write(b"".join(self.connection.send(message) for message in messages))


class Server:
    """Answers as a daemon would; ``on`` replaces the answer to a type of message."""

    def __init__(self):
        self.seats: list[Seat] = []
        self.heard: list[m.Message] = []
        self.gone = asyncio.Event()
        self.lockstep = False
        self.ttl = 1.0
        self.fence = 0
        self.first = state(tick=0)
        self.on: dict[type[m.Message], Callable[[Seat, Any], None]] = {}
        self._news = asyncio.Event()

    @property
    def seat(self) -> Seat:
        return self.seats[-1]

    def say(self, *messages):
        self.seat.say(*messages)

    def take(self, seat, message):
        self.heard.append(message)
        self._news.set()
        self.on.get(type(message), self.answer)(seat, message)

    async def said(self, kind, count=1):
        """The newest message of a kind, once there are so many."""
        async with asyncio.timeout(10):
            while len(found := [x for x in self.heard if isinstance(x, kind)]) < count:
                self._news.clear()
                await self._news.wait()
        return found[-1]

    def count(self, kind):
        return sum(isinstance(message, kind) for message in self.heard)

    def answer(self, seat, message):
        replies = getattr(self, f"_{message.type}")(message)
        seat.say(*replies)

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
