"""Clients that pause, on real sockets: they get the latest state and few old ones, and stay connected."""

import asyncio
import os
import socket

import pytest

from armgate.daemon.sessions import peer_socket as peer_socket_module
from armgate.daemon.sessions.connection_limits import Slot
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.daemon.sessions.session import Session
from armgate.protocol import Connection, Side
from armgate.protocol import messages as m
from armgate.world.interfaces import Client, Encoded
from support.clients import until

PERIOD = 0.004
PAUSE = float(os.environ.get("ARMGATE_PAUSE", "1.5"))
"""Time for which clients pause, s; the long form takes 30."""

FEW = 64
"""Largest number of states that a client receives after a pause: its kernel has buffered the old ones."""


class Host:
    """A host that welcomes every client."""

    serving = True

    def __init__(self):
        self.reasons = []

    def hello(self, session, hello):
        session.identify(Client("s1", hello.name, "controller"), self)
        limits = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
        session.send(
            m.Welcome(
                version=1, versions=(1,), client_versions=(1,), start="d1", session="s1", name="c",
                role="controller", limits=limits,
            )
        )  # fmt: skip

    def left(self, session, reason):
        self.reasons.append(reason)

    def privileged(self, session):
        return False

    def opened(self, session):
        pass

    def closed(self, session):
        pass

    def failed(self, error):
        raise error


class Server:
    """A session on a real socket that is sent a state every few milliseconds."""

    def __init__(self, size):
        self.host = Host()
        self.session = None
        self.tick = 0
        near = m.Nearest(pair=("a" * 64, "b" * 64), distance=1.0, limit=1.0, points=((0.0,) * 3,) * 2)
        entry = m.Entry(robot="A", tick=0, time=0.0, q=(0.5,) * 64, nearest=(near,) * 16)
        rows, rest = divmod(size, 4400)
        self.entries, self.warnings = (entry,) * rows, ("x" * 500,) * (rest // 500)

    async def open(self):
        loop = asyncio.get_running_loop()
        self.server = await loop.create_server(self._session, "127.0.0.1", 0)
        self.port = self.server.sockets[0].getsockname()[1]

    def _session(self):
        self.session = Session(self.host, 1, Slot("127.0.0.1"), 1 << 20, FairScheduler())
        return self.session

    async def send_states(self, seconds):
        """Send states for some seconds."""
        for _ in range(round(seconds / PERIOD)):
            self.tick += 1
            state = m.State(robot="A", tick=self.tick, time=0.0, entries=self.entries, warnings=self.warnings)
            self.session.send_states(Encoded(state))
            await asyncio.sleep(PERIOD)


class Reader:
    """A client on a plain socket that reads only on request."""

    def __init__(self, port, buffer=None):
        self.socket = socket.socket()
        if buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.connection = Connection(Side.CLIENT)
        self.ticks = []
        self.socket.send(self.connection.send(m.Hello(versions=(1,), name="c")))

    async def read(self, until_tick):
        """Read until a tick arrives; return all ticks."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(10):
            while not self.ticks or self.ticks[-1] < until_tick:
                data = await loop.sock_recv(self.socket, 1 << 16)
                assert data, "the server closed the connection"
                self.ticks += [x.tick for x in self.connection.receive(data) if isinstance(x, m.State)]
        return self.ticks


@pytest.fixture
async def paused(request):
    """A server and a connected client that reads only on request."""
    size, buffer = request.param
    server = Server(size)
    await server.open()
    reader = Reader(server.port, buffer)
    await until(lambda: server.session is not None and server.session.greeted)
    yield server, reader
    server.session.abort()
    reader.socket.close()
    server.server.close()


@pytest.mark.daily(1)
@pytest.mark.parametrize("paused", [(1500, None), (1500, 4096), (9000, None)], indirect=True)
async def test_a_client_that_paused_gets_the_latest_state_and_few_old_ones(paused):
    server, reader = paused
    await server.send_states(0.1)
    await reader.read(server.tick)
    reader.ticks.clear()
    await server.send_states(PAUSE)
    newest = server.tick
    ticks = await reader.read(newest)
    assert len(ticks) <= FEW
    assert ticks == sorted(set(ticks))
    reader.ticks.clear()
    await asyncio.gather(reader.read(newest + 50), server.send_states(50 * PERIOD))
    assert len(reader.ticks) > 25, "the client reads again, and receives most of the new states"


@pytest.mark.daily(1)
@pytest.mark.parametrize("paused", [(1500, None), (140_000, None), (140_000, 4096)], indirect=True)
async def test_a_client_that_reads_nothing_is_not_aborted_for_unread_states(paused, monkeypatch):
    """States of 140 kB do not fit into the client's TCP window: the window is closed; probes are answered."""
    monkeypatch.setattr(peer_socket_module, "_GIVE_UP", min(0.5, PAUSE / 3))
    monkeypatch.setattr(peer_socket_module, "_WATCH", 0.1)
    server, reader = paused
    await server.send_states(PAUSE)
    assert server.host.reasons == []
    newest = server.tick
    await asyncio.gather(reader.read(newest + 10), server.send_states(0.5))


@pytest.mark.parametrize("paused", [(1500, None)], indirect=True)
async def test_a_client_that_reads_gets_every_state(paused):
    server, reader = paused
    await asyncio.gather(reader.read(100), server.send_states(100 * PERIOD))
    assert reader.ticks == list(range(1, 101))


@pytest.mark.parametrize("paused", [(1500, None)], indirect=True)
async def test_unread_answers_are_bounded(paused):
    server, _ = paused
    for _ in range(100):
        server.session.send(m.Error(code="x", text="y" * 500, fatal=False))
        server.session.send(m.Chunk(hash="0" * 64, offset=0, total=1, data=b"z" * 200_000))
        await asyncio.sleep(0)
    await until(lambda: server.host.reasons)
    assert server.host.reasons[0].startswith("overflow")


async def test_an_unreachable_client_is_distinguished_from_one_that_does_not_read():
    class Socket:
        head = [0] * 32

        def setsockopt(self, *arguments):
            pass

        def getsockopt(self, level, option, size):
            return peer_socket_module._HEAD.pack(*self.head)

    line = peer_socket_module.TcpPeerSocket(Socket())
    Socket.head[peer_socket_module._LAST_ACK] = Socket.head[peer_socket_module._LAST_DATA] = 60_000
    Socket.head[peer_socket_module._UNACKED] = 1
    assert [line.is_unreachable() for _ in range(3)] == [
        False
    ] * 3  # the last data were answered, and no probe is outstanding
    Socket.head[peer_socket_module._PROBES] = 1
    assert [line.is_unreachable() for _ in range(2)] == [False, True]
    Socket.head[peer_socket_module._PROBES] = 0
    assert not line.is_unreachable()
    Socket.head[peer_socket_module._LAST_DATA] = 30_000
    assert [line.is_unreachable() for _ in range(2)] == [False, True]
    assert line.is_read()  # an older kernel does not report the window
