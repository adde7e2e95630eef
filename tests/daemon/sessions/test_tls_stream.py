"""TLS of a connection: decrypted in small pieces, each in a turn of the session."""

import asyncio
import contextlib
import io
import socket
import ssl
from time import monotonic

import pytest

from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.tls import server_context
from armgate.daemon.sessions.connection_limits import ConnectionLimits
from armgate.daemon.sessions.listener import ConnectionProtocol, Listener
from armgate.links.log import Log
from support.certificates import Authority
from support.clients import PATIENCE, until

RECORDS = 3000
FEW = 2048 // 22
"""Records that a piece may hold: each is 22 bytes longer than what it carries."""


class Seat(asyncio.Protocol, ConnectionProtocol):
    """A connection whose turns the test gives; it notes the bytes that arrive in each."""

    def __init__(self):
        self.turns, self.got, self.transport, self.paused = [], [], None, False

    def serve(self, work):
        self.turns.append(work)

    def give_turns(self):
        while self.turns:
            self.got.append(0)
            self.turns.pop(0)()

    def connection_made(self, transport):
        self.transport = transport

    def data_received(self, data):
        self.got[-1] += len(data)

    def pause_writing(self):
        self.paused = True

    def evict(self):
        self.transport.close()


class Client:
    """TLS in memory over a socket, so that the test decides when bytes are sent."""

    def __init__(self, sock, context):
        self.sock, self.incoming, self.outgoing = sock, ssl.MemoryBIO(), ssl.MemoryBIO()
        self.tls = context.wrap_bio(self.incoming, self.outgoing, server_hostname="127.0.0.1")

    async def send(self):
        await asyncio.get_running_loop().sock_sendall(self.sock, self.outgoing.read())

    async def shake_hands(self):
        while True:
            try:
                self.tls.do_handshake()
                await self.send()
                return
            except ssl.SSLWantReadError:
                await self.send()
                self.incoming.write(await asyncio.get_running_loop().sock_recv(self.sock, 65536))


@contextlib.asynccontextmanager
async def connection(folder):
    """Connect a client to a listener with TLS."""
    authority, seat, room = Authority(folder), Seat(), ConnectionLimits(10, 10)
    log = Log(io.StringIO())
    listener = Listener(
        lambda guest: seat, room, rate=1e6, tls=server_context(*authority.issue("cell", "127.0.0.1"), None),
        handshake=PATIENCE, log=log, refused=FailureLog(1e6, 1e6, monotonic()),
    )  # fmt: skip
    port = await listener.open("127.0.0.1", 0)
    sock = socket.socket()
    sock.setblocking(False)
    await asyncio.get_running_loop().sock_connect(sock, ("127.0.0.1", port))
    try:
        yield seat, Client(sock, ssl.create_default_context(cafile=authority.file))
    finally:
        if seat.transport is not None:
            seat.transport.abort()
        sock.close()
        listener.close()
        await asyncio.sleep(0)
        log.close()


async def giving_turns(seat, task):
    while not task.done():
        seat.give_turns()
        await asyncio.sleep(0)


async def connected(seat, client):
    shaking = asyncio.create_task(client.shake_hands())
    await asyncio.wait_for(giving_turns(seat, shaking), PATIENCE)
    await until(lambda: seat.give_turns() or seat.transport is not None)


async def test_a_handshake_waits_for_its_turn(tmp_path):
    async with connection(tmp_path) as (seat, client):
        shaking = asyncio.create_task(client.shake_hands())
        await until(lambda: seat.turns)
        for _ in range(20):
            await asyncio.sleep(0)
        assert len(seat.turns) == 1
        assert not shaking.done()
        await asyncio.wait_for(giving_turns(seat, shaking), PATIENCE)


async def send_records(client):
    """Send many records of one byte, all at once."""
    for _ in range(RECORDS):
        client.tls.write(b"x")
    await client.send()


async def test_a_turn_decrypts_only_a_few_records(tmp_path):
    async with connection(tmp_path) as (seat, client):
        await connected(seat, client)
        seat.got.clear()
        sending = asyncio.create_task(send_records(client))
        await until(lambda: seat.give_turns() or sum(seat.got) == RECORDS)
        await sending
        assert max(seat.got) <= FEW


@pytest.mark.parametrize("turns", [True, False])
async def test_a_session_that_is_not_read_keeps_few_records_that_wait(tmp_path, turns):
    async with connection(tmp_path) as (seat, client):
        await connected(seat, client)
        seat.got.clear()
        if turns:
            seat.transport.pause_reading()
        sending = asyncio.create_task(send_records(client))
        for _ in range(1000):
            if turns:
                seat.give_turns()
            await asyncio.sleep(0)
        assert sum(seat.got) == 0
        if turns:
            seat.got[:] = [0]
            seat.transport.resume_reading()
            await until(lambda: seat.got[0])
            assert seat.got[0] <= 2 * FEW
        await until(lambda: seat.give_turns() or sum(seat.got) == RECORDS)
        await sending


async def test_a_piece_that_waits_for_its_turn_is_dropped_with_its_connection(tmp_path):
    async with connection(tmp_path) as (seat, client):
        await connected(seat, client)
        seat.got.clear()
        client.tls.write(b"x")
        await client.send()
        await until(lambda: seat.turns)
        seat.transport.abort()
        for _ in range(5):
            await asyncio.sleep(0)
        seat.give_turns()
        assert seat.got == [0]


async def test_data_that_a_client_does_not_read_wait_in_the_session(tmp_path):
    async with connection(tmp_path) as (seat, client):
        await connected(seat, client)
        seat.transport.set_write_buffer_limits(high=1, low=0)
        while not seat.paused:
            seat.transport.write(b"x" * 1000)
        under = seat.transport._ssl_protocol._transport
        assert under.get_write_buffer_size() + seat.transport.get_write_buffer_size() < 3000
