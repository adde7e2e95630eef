"""Acceptance of connections: limits, rate, TLS, and refusals."""

import asyncio
import io
import socket
import ssl
from time import monotonic

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.tls import TlsError, is_for_clients, server_context
from armgate.daemon.sessions import listener as module
from armgate.daemon.sessions.connection_limits import ConnectionLimits
from armgate.daemon.sessions.listener import ConnectionProtocol, Listener
from armgate.links.log import Log
from support.certificates import Authority, encrypted
from support.clients import PATIENCE, until


class CountedConnection(asyncio.Protocol, ConnectionProtocol):
    """A connection that records when it is made, lost and evicted."""

    def __init__(self, bench, slot):
        self.bench, self.slot = bench, slot

    def connection_made(self, transport):
        self.transport = transport
        self.bench.connections.append(self)

    def evict(self):
        self.bench.evicted += 1
        self.transport.close()

    def serve(self, work):
        work()

    def connection_lost(self, exc):
        self.bench.listener.left(self.slot)
        self.bench.lost += 1


class ListenerBench:
    """A listener, its connections, and clients."""

    def __init__(self, **more):
        self.connections, self.clients, self.lost, self.evicted = [], [], 0, 0
        self.log = io.StringIO()
        self.writer = Log(self.log)
        given = {"rate": 1e6, "tls": None, "handshake": 5.0, "refused": FailureLog(1e6, 1e6, 0.0)}
        self.limits = ConnectionLimits(more.pop("in_all", 100), more.pop("per_origin", 100))
        self.listener = Listener(
            lambda slot: CountedConnection(self, slot), self.limits, log=self.writer, **given | more
        )

    async def __aenter__(self):
        self.port = await self.listener.open("127.0.0.1", 0)
        return self

    async def __aexit__(self, *_):
        for client in self.clients:
            client.close()
        self.listener.close()
        await until(lambda: self.lost == len(self.connections))
        self.writer.close()

    async def connect(self, count):
        """Connect some clients; wait until the kernel has them, not until they are accepted."""
        loop = asyncio.get_running_loop()
        for _ in range(count):
            sock = socket.socket()
            sock.setblocking(False)
            self.clients.append(sock)
            await loop.sock_connect(sock, ("127.0.0.1", self.port))

    async def accepted(self, count):
        await until(lambda: len(self.connections) >= count, turns=10**7)

    def admit(self, count, role="controller"):
        """Make sessions of the first connections."""
        for connection in self.connections[:count]:
            assert self.limits.admit(connection.slot, role, "") == ""

    @property
    def refusals(self):
        return [connection.slot.refusal for connection in self.connections if connection.slot.refusal]


async def test_nagles_algorithm_is_off():
    async with ListenerBench() as bench:
        await bench.connect(1)
        await bench.accepted(1)
        sock = bench.connections[0].transport.get_extra_info("socket")
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


async def test_the_total_number_of_connections_is_bounded_and_a_closed_one_frees_its_place():
    async with ListenerBench(in_all=3) as bench:
        await bench.connect(3)
        await bench.accepted(3)
        bench.admit(3)
        await bench.connect(1)
        await bench.accepted(4)
        assert ["all 3 places for connections are taken" in text for text in bench.refusals] == [True]
        bench.clients[0].close()
        await until(lambda: bench.lost == 1)
        await bench.connect(1)
        await bench.accepted(5)
        assert len(bench.refusals) == 1


async def test_connections_from_one_address_are_bounded():
    async with ListenerBench(per_origin=2) as bench:
        await bench.connect(2)
        await bench.accepted(2)
        bench.admit(2)
        await bench.connect(1)
        await bench.accepted(3)
        (text,) = bench.refusals
        assert "from your address" in text


async def test_the_oldest_connection_without_a_hello_makes_room_for_a_new_one():
    async with ListenerBench(per_origin=3) as bench:
        await bench.connect(3)
        await bench.accepted(3)
        bench.admit(1)
        await bench.connect(2)
        await bench.accepted(5)
        await until(lambda: bench.lost == 2)
        assert (bench.evicted, bench.refusals) == (2, [])
        assert [connection.transport.is_closing() for connection in bench.connections] == [
            False,
            True,
            True,
            False,
            False,
        ]


async def test_a_connection_in_its_tls_handshake_makes_room_too(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with ListenerBench(tls=context, in_all=2, handshake=60.0) as bench:
        await bench.connect(5)
        loop = asyncio.get_running_loop()
        for client in bench.clients[:3]:
            assert await asyncio.wait_for(loop.sock_recv(client, 1), PATIENCE) == b""
        assert len(bench.limits._waiting) == 2
    await until(lambda: bench.limits.empty)


async def test_refused_connections_that_still_get_a_reason_are_bounded(monkeypatch):
    monkeypatch.setattr(module, "_LEAVING", 2)
    async with ListenerBench(in_all=2) as bench:
        await bench.connect(2)
        await bench.accepted(2)
        bench.admit(2)
        await bench.connect(8)
        await bench.accepted(4)
        loop = asyncio.get_running_loop()
        for client in bench.clients[4:]:
            assert await asyncio.wait_for(loop.sock_recv(client, 1), PATIENCE) == b""
        assert len(bench.connections) == 4


async def test_connections_that_arrive_too_fast_wait_and_are_accepted_later():
    async with ListenerBench(rate=50.0) as bench:
        await bench.connect(40)
        await bench.accepted(32)
        for _ in range(20):
            await asyncio.sleep(0)
        assert len(bench.connections) < 40
        await bench.accepted(40)


async def test_a_few_connections_are_accepted_in_each_turn():
    async with ListenerBench() as bench:
        accept, turns = bench.listener._accept, []
        accept_and_count = lambda sock: (accept(sock), turns.append(len(bench.listener._handshakes)))  # noqa: E731
        loop = asyncio.get_running_loop()
        sock = bench.listener._sockets[0]
        loop.remove_reader(sock)
        await bench.connect(12)
        loop.add_reader(sock, accept_and_count, sock)
        await bench.accepted(12)
        assert turns[0] == 4


async def test_a_port_in_use_is_an_error_and_nothing_stays_open():
    async with ListenerBench() as bench:
        other = ListenerBench()
        with pytest.raises(OSError, match="in use"):
            await other.listener.open("127.0.0.1", bench.port)
        assert other.listener._sockets == []
        other.writer.close()


async def test_localhost_listens_on_every_loopback_address_with_one_port():
    bench = ListenerBench()
    port = await bench.listener.open("localhost", 0)
    assert {sock.getsockname()[1] for sock in bench.listener._sockets} == {port}
    bench.listener.close()
    bench.writer.close()


async def test_a_half_open_tls_handshake_ends_in_time_and_frees_its_place(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with ListenerBench(tls=context, in_all=1, handshake=0.1) as bench:
        await bench.connect(1)
        loop = asyncio.get_running_loop()
        assert await asyncio.wait_for(loop.sock_recv(bench.clients[0], 1), PATIENCE) == b""
        await until(lambda: bench.limits.empty)
        await bench.connect(1)
        await loop.sock_sendall(bench.clients[1], b"GET / HTTP/1.1\r\n\r\n")
        assert await asyncio.wait_for(loop.sock_recv(bench.clients[1], 4096), PATIENCE) is not None
        await until(lambda: bench.limits.empty)
        assert bench.lost == 0
    assert bench.log.getvalue().count("tls.failed") == 2


async def test_failed_tls_is_logged_up_to_a_bound(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with ListenerBench(tls=context, refused=FailureLog(2.0, 2.0, monotonic())) as bench:
        await bench.connect(6)
        loop = asyncio.get_running_loop()
        for client in bench.clients:
            await loop.sock_sendall(client, b"GET / HTTP/1.1\r\n\r\n")
        for client in bench.clients:
            while await asyncio.wait_for(loop.sock_recv(client, 4096), PATIENCE):
                pass
        await until(lambda: bench.limits.empty)
    assert bench.log.getvalue().count("tls.failed") == 2


# --- files ------------------------------------------------------------------------------------------------


def test_a_certificate_that_cannot_be_used_is_named(tmp_path):
    authority = Authority(tmp_path)
    certificate, key = authority.issue("cell", "127.0.0.1")
    other = Authority(tmp_path, "other").issue("else", "127.0.0.1")
    server_context(certificate, key, authority.file)
    for files, told in (
        ((tmp_path / "none.pem", key, None), "none.pem: No such file"),
        ((certificate, other[1], None), "KEY_VALUES_MISMATCH"),
        ((certificate, encrypted(key), None), "the key is encrypted"),
        ((key, key, None), "expected a certificate"),
        ((certificate, key, key), "expected certificates of CAs"),
    ):
        with pytest.raises(TlsError, match=told):
            server_context(*files)


def test_a_key_that_other_users_may_read_is_refused(tmp_path):
    certificate, key = Authority(tmp_path).issue("cell", "127.0.0.1")
    for mode in (0o644, 0o640):
        key.chmod(mode)
        with pytest.raises(TlsError, match="chmod 600"):
            server_context(certificate, key, None)


@pytest.mark.parametrize(
    ("purposes", "expected"),
    [
        ((), False),
        (("SERVER_AUTH",), False),
        (("CLIENT_AUTH",), True),
        (("SERVER_AUTH", "CLIENT_AUTH"), True),
    ],
)
def test_the_purpose_of_a_certificate(tmp_path, purposes, expected):
    file, _ = Authority(tmp_path).issue("one", None, purposes)
    der = ssl.PEM_cert_to_DER_cert(file.read_text())
    assert is_for_clients(der) is expected
    for end in range(0, len(der), 7):
        assert not is_for_clients(der[:end])


@pytest.mark.parametrize(
    "data",
    [
        bytes.fromhex("3000"),  # nothing in it
        bytes.fromhex("30083006a30430023000"),  # an extension without an id
    ],
)
def test_a_truncated_certificate_is_not_for_clients(data):
    assert not is_for_clients(data)


@given(st.binary(max_size=60))
def test_bytes_that_are_no_certificate_are_not_for_clients(data):
    assert not is_for_clients(data)
