"""Connections that are accepted: which, how many, how fast."""

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


class Seat(asyncio.Protocol, ConnectionProtocol):
    """A connection that counts when it is made, lost and evicted."""

    def __init__(self, house, guest):
        self.house, self.guest = house, guest

    def connection_made(self, transport):
        self.transport = transport
        self.house.places.append(self)

    def evict(self):
        self.house.evicted += 1
        self.transport.close()

    def serve(self, work):
        work()

    def connection_lost(self, exc):
        self.house.listener.left(self.guest)
        self.house.lost += 1


class House:
    """A listener, its connections, and clients."""

    def __init__(self, **more):
        self.places, self.clients, self.lost, self.evicted = [], [], 0, 0
        self.log = io.StringIO()
        self.writer = Log(self.log)
        given = {"rate": 1e6, "tls": None, "handshake": 5.0, "refused": FailureLog(1e6, 1e6, 0.0)}
        self.room = ConnectionLimits(more.pop("in_all", 100), more.pop("per_origin", 100))
        self.listener = Listener(lambda guest: Seat(self, guest), self.room, log=self.writer, **given | more)

    async def __aenter__(self):
        self.port = await self.listener.open("127.0.0.1", 0)
        return self

    async def __aexit__(self, *_):
        for client in self.clients:
            client.close()
        self.listener.close()
        await until(lambda: self.lost == len(self.places))
        self.writer.close()

    async def connect(self, count):
        """Connect some clients; wait until the kernel has them, not until they are accepted."""
        loop = asyncio.get_running_loop()
        for _ in range(count):
            sock = socket.socket()
            sock.setblocking(False)
            self.clients.append(sock)
            await loop.sock_connect(sock, ("127.0.0.1", self.port))

    async def seated(self, count):
        await until(lambda: len(self.places) >= count, turns=10**7)

    def admit(self, count, role="controller"):
        """Make sessions of the first connections."""
        for place in self.places[:count]:
            assert self.room.admit(place.guest, role, "") == ""

    @property
    def refusals(self):
        return [place.guest.refusal for place in self.places if place.guest.refusal]


async def test_nagles_algorithm_is_off():
    async with House() as house:
        await house.connect(1)
        await house.seated(1)
        sock = house.places[0].transport.get_extra_info("socket")
        assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


async def test_connections_in_all_are_bounded_and_a_closed_one_frees_its_place():
    async with House(in_all=3) as house:
        await house.connect(3)
        await house.seated(3)
        house.admit(3)
        await house.connect(1)
        await house.seated(4)
        assert ["all 3 places for connections are taken" in text for text in house.refusals] == [True]
        house.clients[0].close()
        await until(lambda: house.lost == 1)
        await house.connect(1)
        await house.seated(5)
        assert len(house.refusals) == 1


async def test_connections_from_one_address_are_bounded():
    async with House(per_origin=2) as house:
        await house.connect(2)
        await house.seated(2)
        house.admit(2)
        await house.connect(1)
        await house.seated(3)
        (text,) = house.refusals
        assert "from your address" in text


async def test_the_oldest_connection_without_a_hello_makes_room_for_a_new_one():
    async with House(per_origin=3) as house:
        await house.connect(3)
        await house.seated(3)
        house.admit(1)
        await house.connect(2)
        await house.seated(5)
        await until(lambda: house.lost == 2)
        assert (house.evicted, house.refusals) == (2, [])
        assert [place.transport.is_closing() for place in house.places] == [False, True, True, False, False]


async def test_a_connection_in_its_tls_handshake_makes_room_too(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with House(tls=context, in_all=2, handshake=60.0) as house:
        await house.connect(5)
        loop = asyncio.get_running_loop()
        for client in house.clients[:3]:
            assert await asyncio.wait_for(loop.sock_recv(client, 1), PATIENCE) == b""
        assert len(house.room._waiting) == 2
    await until(lambda: house.room.empty)


async def test_refused_connections_that_still_get_a_reason_are_bounded(monkeypatch):
    monkeypatch.setattr(module, "_LEAVING", 2)
    async with House(in_all=2) as house:
        await house.connect(2)
        await house.seated(2)
        house.admit(2)
        await house.connect(8)
        await house.seated(4)
        loop = asyncio.get_running_loop()
        for client in house.clients[4:]:
            assert await asyncio.wait_for(loop.sock_recv(client, 1), PATIENCE) == b""
        assert len(house.places) == 4


async def test_connections_that_arrive_too_fast_wait_and_are_accepted_later():
    async with House(rate=50.0) as house:
        await house.connect(40)
        await house.seated(32)
        for _ in range(20):
            await asyncio.sleep(0)
        assert len(house.places) < 40
        await house.seated(40)


async def test_a_few_connections_are_accepted_in_each_turn():
    async with House() as house:
        accept, turns = house.listener._accept, []
        monkey = lambda sock: (accept(sock), turns.append(len(house.listener._handshakes)))  # noqa: E731
        loop = asyncio.get_running_loop()
        sock = house.listener._sockets[0]
        loop.remove_reader(sock)
        await house.connect(12)
        loop.add_reader(sock, monkey, sock)
        await house.seated(12)
        assert turns[0] == 4


async def test_a_port_in_use_is_an_error_and_nothing_stays_open():
    async with House() as house:
        other = House()
        with pytest.raises(OSError, match="in use"):
            await other.listener.open("127.0.0.1", house.port)
        assert other.listener._sockets == []
        other.writer.close()


async def test_localhost_listens_on_every_loopback_address_with_one_port():
    house = House()
    port = await house.listener.open("localhost", 0)
    assert {sock.getsockname()[1] for sock in house.listener._sockets} == {port}
    house.listener.close()
    house.writer.close()


async def test_a_half_open_tls_handshake_ends_in_time_and_frees_its_place(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with House(tls=context, in_all=1, handshake=0.1) as house:
        await house.connect(1)
        loop = asyncio.get_running_loop()
        assert await asyncio.wait_for(loop.sock_recv(house.clients[0], 1), PATIENCE) == b""
        await until(lambda: house.room.empty)
        await house.connect(1)
        await loop.sock_sendall(house.clients[1], b"GET / HTTP/1.1\r\n\r\n")
        assert await asyncio.wait_for(loop.sock_recv(house.clients[1], 4096), PATIENCE) is not None
        await until(lambda: house.room.empty)
        assert house.lost == 0
    assert house.log.getvalue().count("tls.failed") == 2


async def test_failed_tls_is_logged_up_to_a_bound(tmp_path):
    context = server_context(*Authority(tmp_path).issue("cell", "127.0.0.1"), None)
    async with House(tls=context, refused=FailureLog(2.0, 2.0, monotonic())) as house:
        await house.connect(6)
        loop = asyncio.get_running_loop()
        for client in house.clients:
            await loop.sock_sendall(client, b"GET / HTTP/1.1\r\n\r\n")
        for client in house.clients:
            while await asyncio.wait_for(loop.sock_recv(client, 4096), PATIENCE):
                pass
        await until(lambda: house.room.empty)
    assert house.log.getvalue().count("tls.failed") == 2


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
