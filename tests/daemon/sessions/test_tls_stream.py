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
"""Upper bound of the number of records in a piece of 2048 bytes: a record has at least 22 bytes."""


class SteppedConnection(asyncio.Protocol, ConnectionProtocol):
    """A connection that works only in turns that the test starts, and counts the bytes of each turn."""

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
    authority, stepped, room = Authority(folder), SteppedConnection(), ConnectionLimits(10, 10)
    log = Log(io.StringIO())
    listener = Listener(
        lambda slot: stepped, room, rate=1e6, tls=server_context(*authority.issue("cell", "127.0.0.1"), None),
        handshake=PATIENCE, log=log, refused=FailureLog(1e6, 1e6, monotonic()),
    )  # fmt: skip
    port = await listener.open("127.0.0.1", 0)
    sock = socket.socket()
    sock.setblocking(False)
    await asyncio.get_running_loop().sock_connect(sock, ("127.0.0.1", port))
    try:
        yield stepped, Client(sock, ssl.create_default_context(cafile=authority.file))
    finally:
        if stepped.transport is not None:
            stepped.transport.abort()
        sock.close()
        listener.close()
        await asyncio.sleep(0)
        log.close()


async def giving_turns(stepped, task):
    while not task.done():
        stepped.give_turns()
        await asyncio.sleep(0)


async def connected(stepped, client):
    shaking = asyncio.create_task(client.shake_hands())
    await asyncio.wait_for(giving_turns(stepped, shaking), PATIENCE)
    await until(lambda: stepped.give_turns() or stepped.transport is not None)


async def test_a_handshake_waits_for_its_turn(tmp_path):
    async with connection(tmp_path) as (stepped, client):
        shaking = asyncio.create_task(client.shake_hands())
        await until(lambda: stepped.turns)
        for _ in range(20):
            await asyncio.sleep(0)
        assert len(stepped.turns) == 1
        assert not shaking.done()
        await asyncio.wait_for(giving_turns(stepped, shaking), PATIENCE)


async def send_records(client):
    """Send many records of one byte, all at once."""
    for _ in range(RECORDS):
        client.tls.write(b"x")
    await client.send()


async def test_a_turn_decrypts_only_a_few_records(tmp_path):
    async with connection(tmp_path) as (stepped, client):
        await connected(stepped, client)
        stepped.got.clear()
        sending = asyncio.create_task(send_records(client))
        await until(lambda: stepped.give_turns() or sum(stepped.got) == RECORDS)
        await sending
        assert max(stepped.got) <= FEW


@pytest.mark.parametrize("turns", [True, False])
async def test_a_session_that_is_not_read_holds_few_waiting_records(tmp_path, turns):
    async with connection(tmp_path) as (stepped, client):
        await connected(stepped, client)
        stepped.got.clear()
        if turns:
            stepped.transport.pause_reading()
        sending = asyncio.create_task(send_records(client))
        for _ in range(1000):
            if turns:
                stepped.give_turns()
            await asyncio.sleep(0)
        assert sum(stepped.got) == 0
        if turns:
            stepped.got[:] = [0]
            stepped.transport.resume_reading()
            await until(lambda: stepped.got[0])
            assert stepped.got[0] <= 2 * FEW
        await until(lambda: stepped.give_turns() or sum(stepped.got) == RECORDS)
        await sending


async def test_a_piece_that_waits_for_its_turn_is_dropped_with_its_connection(tmp_path):
    async with connection(tmp_path) as (stepped, client):
        await connected(stepped, client)
        stepped.got.clear()
        client.tls.write(b"x")
        await client.send()
        await until(lambda: stepped.turns)
        stepped.transport.abort()
        for _ in range(5):
            await asyncio.sleep(0)
        stepped.give_turns()
        assert stepped.got == [0]


async def test_data_that_a_client_does_not_read_wait_in_the_session(tmp_path):
    async with connection(tmp_path) as (stepped, client):
        await connected(stepped, client)
        stepped.transport.set_write_buffer_limits(high=1, low=0)
        while not stepped.paused:
            stepped.transport.write(b"x" * 1000)
        under = stepped.transport._ssl_protocol._transport
        assert under.get_write_buffer_size() + stepped.transport.get_write_buffer_size() < 3000
