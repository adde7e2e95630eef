"""One connection, with a transport in memory."""

import asyncio
import itertools
import socket
from time import monotonic

import msgpack
import pytest

from armgate.daemon.sessions.connection_limits import Slot
from armgate.daemon.sessions.peer_socket import TcpPeerSocket
from armgate.daemon.sessions.rate_limits import RateLimit, RateLimits, Rates
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.daemon.sessions.session import Session
from armgate.protocol import Connection, ErrorCode, RemoteProtocolError, Side, encode
from armgate.protocol import messages as m
from armgate.protocol.framing import frame
from armgate.world.interfaces import Client, Encoded
from support.clients import until


class Transport(asyncio.Transport):
    """A transport that keeps written bytes."""

    def __init__(self):
        super().__init__()
        self.written = b""
        self.writes = 0
        self.eof = self.aborted = self.closed = False
        self.resumed = asyncio.Event()
        self.socket = socket.socket()
        self.peername = ("127.0.0.1", 4711)

    def get_extra_info(self, name, default=None):
        return {"socket": self.socket, "peername": self.peername}.get(name, default)

    def set_write_buffer_limits(self, high=None, low=None):
        self.high = high

    def write(self, data):
        assert not self.eof
        self.written += data
        self.writes += 1

    def can_write_eof(self):
        return True

    def write_eof(self):
        self.eof = True

    def pause_reading(self):
        self.reading = False

    def resume_reading(self):
        self.reading = True
        self.resumed.set()

    def is_closing(self):
        return self.aborted or self.closed

    def close(self):
        self.closed = True

    def abort(self):
        self.aborted = True


class Host:
    """A host that welcomes every client, and keeps what it receives."""

    def __init__(self):
        self.received = []
        self.fail_on = None
        self.privilege = False
        self.serving = True

    def opened(self, session):
        self.received.append("opened")

    def hello(self, session, hello):
        session.identify(Client("s1", hello.name, "controller", identity=session.slot.origin), self)
        session.stay()
        limits = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
        session.send(
            m.Welcome(
                version=1,
                versions=(1,),
                client_versions=hello.versions,
                start="d1",
                session="s1",
                name=hello.name,
                role=hello.role,
                limits=limits,
            )
        )

    def handle(self, session, message):
        if message.type == self.fail_on:
            raise RuntimeError("broken")
        self.received.append(message)
        if isinstance(message, m.Signal):
            session.send(m.Signaled(name=message.name))

    def left(self, session, reason):
        self.received.append(f"left: {reason}")

    def closed(self, session):
        self.received.append("closed")

    def failed(self, error):
        self.received.append(error)

    def privileged(self, session):
        return self.privilege


class Wire:
    """A session with its host, its transport, and the client's end."""

    def __init__(self, send_buffer=1000, limit=None, clock=lambda: 0.0):
        self.host = Host()
        self.session = Session(
            self.host, 1, Slot("127.0.0.1"), send_buffer, FairScheduler(clock), limit=limit
        )
        self.transport = Transport()
        self.session.connection_made(self.transport)
        self.client = Connection(Side.CLIENT)

    def send(self, *messages):
        self.arrive(b"".join(self.client.send(message) for message in messages))

    def arrive(self, data):
        """Pass bytes to the session as asyncio does: through its buffer, as many at once as fit."""
        while data:
            buffer = self.session.get_buffer(-1)
            taken = len(buffer[: len(data)])
            buffer[:taken] = data[:taken]
            self.session.buffer_updated(taken)
            data = data[taken:]

    def hello(self):
        self.send(m.Hello(versions=(1,), name="wave"))
        assert isinstance(self.received()[0], m.Welcome)
        return self

    def received(self):
        data, self.transport.written = self.transport.written, b""
        return self.client.receive(data)


@pytest.fixture
async def line():
    """A session on whose clock no time passes: all waiting work is done in one turn."""
    line = Wire()
    yield line
    line.session.stay()
    line.transport.socket.close()


@pytest.fixture
async def slow():
    """A session on whose clock each piece of work takes a whole turn."""
    line = Wire(clock=itertools.count().__next__)
    yield line
    line.session.stay()
    line.transport.socket.close()


def state(robot="A", tick=0):
    made = m.State(robot=robot, tick=tick, time=0.0, entries=())
    return Encoded(made)


async def test_messages_reach_the_handler_in_order(line):
    line.hello()
    line.send(m.Ping(time=1.0), m.Ping(time=2.0))
    assert [x.time for x in line.host.received[1:]] == [1.0, 2.0]
    assert line.session.address == "127.0.0.1:4711"


async def test_messages_may_arrive_byte_by_byte(line):
    line.hello()
    for byte in line.client.send(m.Ping(time=1.0)):
        line.arrive(bytes([byte]))
    assert line.host.received[-1].time == 1.0


async def test_an_unreadable_message_is_answered_and_the_next_one_is_handled(line):
    line.hello()
    line.arrive(encode(m.Ping.model_construct(type="ping", time="late", id=3)))
    error = line.received()[0]
    assert (error.code, error.fatal, error.re) == ("invalid_message", False, 3)
    line.send(m.Ping(time=1.0))
    assert line.host.received[-1].time == 1.0


async def test_garbage_ends_the_connection_with_a_named_error_that_can_still_be_read(line):
    line.hello()
    line.arrive(b"\xff\xff\xff\xff and more")
    line.arrive(b"and more")
    error = line.received()[0]
    assert (error.code, error.fatal) == ("frame_too_large", True)
    assert line.transport.eof
    assert not line.transport.aborted
    assert line.host.received[-1].startswith("left: frame_too_large")
    line.session.connection_lost(None)
    assert line.host.received[-1] == "closed"


async def test_an_unknown_version_is_answered_before_the_end(line):
    line.client.versions = (9,)
    line.send(m.Hello(versions=(9,), name="wave"))
    error = line.received()[0]
    assert (error.code, error.fatal) == ("version", True)
    assert "[1]" in error.text


async def test_no_hello_in_time_ends_the_connection(line):
    error = RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, "no hello")
    line.session.allow(0.0, error)
    await until(lambda: line.transport.eof)
    assert line.received()[0].code == "handshake_timeout"


async def test_a_hello_in_time_keeps_the_connection_open(line):
    line.session.allow(0.0, RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, "no hello"))
    line.hello()
    for _ in range(5):
        await asyncio.sleep(0)
    assert not line.transport.eof


async def test_bye_is_answered(line):
    line.hello()
    line.send(m.Bye(reason="done"))
    assert isinstance(line.received()[0], m.Bye)
    assert line.transport.eof
    assert line.host.received[-1] == "left: bye: done"
    line.session.send(m.Pong(time=0.0, received=0.0, sent=0.0))
    assert line.received() == []


async def test_data_for_a_closing_connection_are_read_slowly(line):
    line.hello().session.close(m.Bye())
    assert line.transport.reading
    line.arrive(bytes(1000))
    assert not line.transport.reading
    begin, line.transport.resumed = monotonic(), asyncio.Event()
    await asyncio.wait_for(line.transport.resumed.wait(), 10.0)
    assert monotonic() - begin >= 0.009
    line.arrive(bytes(1000))
    assert not line.transport.reading


async def test_a_transport_that_closes_during_the_pause_is_not_read_again(line, monkeypatch):
    monkeypatch.setattr("armgate.daemon.sessions.reading._DISCARD", 0.01)
    line.session.close(m.Bye())
    line.arrive(b"x" * 100)
    line.transport.reading = False
    line.transport.close()
    await asyncio.sleep(0.03)
    assert not line.transport.reading  # TLS would fail, and the daemon with it


async def test_the_end_of_a_session_is_reported_once(line):
    line.hello()
    line.session.eof_received()
    line.session.send_states(state())
    line.session.connection_lost(None)
    assert [x for x in line.host.received if str(x).startswith("left")] == ["left: closed by the client"]


async def test_a_truncated_frame_is_reported(line):
    line.hello()
    line.arrive(b"\x00\x00\x00\x09abc")
    line.session.eof_received()
    assert "truncated" in line.host.received[-1]


async def test_a_slow_client_gets_only_the_latest_state(line):
    line.hello()
    line.session.pause_writing()
    for tick in range(5):
        line.session.send_states(state("A", tick))
        line.session.send_states(state("B", tick))
    assert line.received() == []
    line.session.resume_writing()
    assert [(s.robot, s.tick) for s in line.received()] == [("A", 4), ("B", 4)]


async def test_unread_verdicts_end_the_connection_and_the_robot_rests(line):
    line.hello()
    line.session.pause_writing()
    for number in range(100):
        line.session.send(m.Error(code="x", text=f"{number}", fatal=False))
    assert line.transport.aborted
    assert not [
        x for x in line.host.received if str(x).startswith("left")
    ]  # the core may be sending to other sessions
    line.session.connection_lost(None)
    assert [x for x in line.host.received if str(x).startswith("left: overflow")]


async def test_waiting_messages_are_written_before_the_end_of_the_stream(line):
    line.hello()
    line.session.pause_writing()
    line.session.close(m.Bye(reason="over"))
    assert not line.transport.eof
    line.session.resume_writing()
    assert line.received()[0].reason == "over"
    assert line.transport.eof


async def test_no_state_follows_the_last_message(line):
    line.hello()
    line.session.pause_writing()
    state = m.State(robot="A", tick=1, time=0.0, entries=())
    line.session.send_states(Encoded(state))
    line.session.close(m.Bye(reason="over"))
    line.session.resume_writing()
    assert [x.type for x in line.received()] == ["bye"]
    assert line.transport.eof


async def test_answers_to_messages_of_one_packet_are_written_together(line):
    line.hello()
    before = line.transport.writes
    line.send(*(m.Signal(name=name, value=(1.0,)) for name in "abc"))
    assert [answer.name for answer in line.received()] == ["a", "b", "c"]
    assert line.transport.writes == before + 1


async def test_a_batch_is_written_when_the_last_open_one_closes(line):
    line.hello()
    first, second = line.session.batch(), line.session.batch()
    line.session.send(m.Signaled(name="a"))
    first.close()
    first.close()
    line.session.send_states(state("A", 1))
    assert line.received() == []
    second.close()
    assert [x.type for x in line.received()] == ["signaled", "state"]


async def test_an_urgent_answer_is_written_at_once_after_what_a_batch_holds(line):
    line.hello()
    line.session.batch()
    line.session.send(m.Signaled(name="a"))
    line.session.send(m.Stopped(stop=1, robots=("A",), reason="", by="x"))
    assert [x.type for x in line.received()] == ["signaled", "stopped"]


async def test_a_batch_is_written_before_the_end_of_the_stream(line):
    line.hello()
    line.session.batch()
    line.session.close(m.Bye(reason="over"))
    assert line.received()[0].reason == "over"
    assert line.transport.eof


async def test_a_client_that_does_not_read_the_last_message_is_aborted(line, monkeypatch):
    monkeypatch.setattr("armgate.daemon.sessions.session._LINGER", 0.0)
    line.hello()
    line.session.close(m.Bye())
    await until(lambda: line.transport.aborted)


async def test_a_client_that_closes_its_end_and_reads_nothing_is_aborted(line, monkeypatch):
    monkeypatch.setattr("armgate.daemon.sessions.session._LINGER", 0.01)
    line.session.pause_writing()
    line.session.eof_received()
    assert line.transport.closed
    assert not line.transport.aborted
    await until(lambda: line.transport.aborted)


async def test_a_defect_is_reported_to_the_host_and_not_raised(line):
    line.hello()
    line.host.fail_on = "ping"
    line.send(m.Ping(time=1.0))
    assert isinstance(line.host.received[-1], RuntimeError)


# --- how much is read -------------------------------------------------------------------------------------


def pings(line, count):
    return b"".join(line.client.send(m.Ping(time=float(number))) for number in range(count))


def pings_received(line):
    return [message.time for message in line.host.received if isinstance(message, m.Ping)]


async def test_a_flood_is_read_a_few_messages_at_each_turn(slow):
    slow.hello()
    await asyncio.sleep(0)
    slow.arrive(pings(slow, 30))
    assert pings_received(slow) == [*range(8)]
    await asyncio.sleep(0)
    assert len(pings_received(slow)) == 16
    await until(lambda: len(pings_received(slow)) == 30)
    assert pings_received(slow) == [*range(30)]


async def test_while_a_session_waits_for_its_turn_reading_is_bounded(slow):
    slow.hello()
    slow.transport.reading = True
    data = pings(slow, 2000)
    slow.arrive(data[:100])  # this turn's time went to the hello
    assert pings_received(slow) == []
    slow.arrive(data[100:200])
    assert slow.transport.reading
    slow.arrive(data[200:])
    assert not slow.transport.reading
    await until(lambda: slow.transport.reading)
    assert 0 < len(pings_received(slow)) < 2000
    await until(lambda: len(pings_received(slow)) == 2000)
    assert pings_received(slow) == [*range(2000)]


@pytest.fixture
async def bounded():
    """A session that is read at 100 messages per second."""
    rates = Rates(client=100.0, identity=1e6, address=1e6, in_all=1e6)
    line = Wire(limit=RateLimit(RateLimits(rates, monotonic), "127.0.0.1"))
    yield line
    line.session.connection_lost(None)
    line.transport.socket.close()


def stops(line):
    return [message.reason for message in line.host.received if isinstance(message, m.Stop)]


async def test_a_stop_overtakes_the_pings_before_it(bounded):
    line = bounded
    line.hello()
    stop = line.client.send(m.Stop(reason="now"))
    data = pings(line, 6000) + stop + pings(line, 10)
    for at in range(0, len(data), 16384):
        line.arrive(data[at : at + 16384])
    await until(lambda: stops(line) == ["now"], turns=100)
    assert len(pings_received(line)) < 100
    assert line.transport.reading


async def test_a_reset_that_a_stop_overtook_is_refused(bounded):
    line = bounded
    line.hello()
    line.arrive(pings(line, 9) + line.client.send(m.Reset(stop=5)) + line.client.send(m.Stop()))
    await until(lambda: len(pings_received(line)) == 9)
    await until(lambda: any(isinstance(message, m.Error) for message in line.received()))
    assert [type(message) for message in line.host.received if isinstance(message, m.Stop | m.Reset)] == [
        m.Stop
    ]


async def test_a_stop_does_not_wait_for_a_rate_limit_that_other_clients_have_used_up():
    allowances = RateLimits(Rates(client=1e6, identity=100.0, address=1e6, in_all=1e6), monotonic)
    line = Wire(limit=RateLimit(allowances, "127.0.0.1")).hello()
    RateLimit(allowances, "127.0.0.1").spend(1000.0, own_limit_only=False)
    line.send(m.Ping(time=0.0), m.Stop(reason="now"))
    await until(lambda: stops(line) == ["now"], turns=100)
    assert pings_received(line) == []
    line.session.connection_lost(None)
    line.transport.socket.close()


async def test_the_number_of_overtaking_stops_is_bounded(bounded):
    line = bounded
    line.hello()
    line.arrive(pings(line, 100) + line.client.send(m.Stop(reason="again")) * 100)
    for _ in range(100):
        await asyncio.sleep(0)
    assert len(stops(line)) == 20


async def test_reading_ahead_is_bounded(bounded):
    line = bounded
    line.hello()
    data = pings(line, 20_000)
    line.arrive(data[: 250 * 1024])
    assert line.transport.reading
    line.arrive(data[250 * 1024 : 300 * 1024])
    assert not line.transport.reading


async def test_a_request_with_a_large_answer_takes_a_whole_turn(slow):
    slow.hello()
    await asyncio.sleep(0)
    slow.arrive(slow.client.send(m.Describe()) * 3)
    asked = lambda: sum(isinstance(message, m.Describe) for message in slow.host.received)  # noqa: E731
    assert asked() == 1
    await asyncio.sleep(0)
    assert asked() == 2


async def test_a_large_message_takes_a_whole_turn(slow):
    slow.hello()
    await asyncio.sleep(0)
    payload = msgpack.packb({"type": "ping", "time": 0.0, "pad": [[1] * 250] * 15})
    slow.arrive(frame(payload) * 3)
    assert len(pings_received(slow)) == 1
    await asyncio.sleep(0)
    assert len(pings_received(slow)) == 2


async def test_messages_that_arrive_while_reading_keep_their_order(line):
    line.hello()
    first, second = pings(line, 10), line.client.send(m.Ping(time=10.0))
    line.arrive(first)
    line.arrive(second)
    assert len(pings_received(line)) == 8
    await until(lambda: len(pings_received(line)) == 11)
    assert pings_received(line) == [*range(11)]


async def test_all_messages_of_a_client_that_closes_after_a_flood_are_read(line):
    line.hello()
    line.arrive(pings(line, 30))
    assert line.session.eof_received() is True
    await until(lambda: line.transport.closed)
    assert pings_received(line) == [*range(30)]
    assert line.host.received[-1] == "left: closed by the client"
    line.session.connection_lost(None)
    assert line.host.received[-1] == "closed"


async def test_after_the_end_of_a_tls_stream_the_rest_is_read_in_turns_too(line, monkeypatch):
    monkeypatch.setattr(line.transport, "can_write_eof", lambda: False)
    line.hello()
    line.arrive(pings(line, 30))
    assert line.session.eof_received() is False
    line.session.connection_lost(None)
    assert len(pings_received(line)) == 8
    await until(lambda: line.host.received[-1] == "closed")
    assert pings_received(line) == [*range(30)]
    assert line.host.received[-2:] == ["left: closed by the client", "closed"]


async def test_leaving_is_reported_if_a_client_is_aborted_while_the_rest_of_its_stream_is_read(
    line, monkeypatch
):
    monkeypatch.setattr(line.transport, "can_write_eof", lambda: False)
    line.hello()
    line.arrive(pings(line, 30))
    line.session.eof_received()
    line.session.connection_lost(None)
    line.session.abort()
    await until(lambda: line.host.received[-1] == "closed")
    assert line.host.received[-2].startswith("left: ")


async def test_a_lost_connection_is_not_watched_while_the_rest_of_its_stream_is_read(monkeypatch):
    monkeypatch.setattr("armgate.daemon.sessions.peer_socket._WATCH", 0.0)
    line = Wire().hello()
    watched = []
    monkeypatch.setattr(TcpPeerSocket, "is_unreachable", lambda self: watched.append(1))
    line.arrive(pings(line, 30))
    line.session.eof_received()
    line.session.connection_lost(None)
    line.transport.socket.close()
    await until(lambda: line.host.received[-1] == "closed")
    await asyncio.sleep(0.01)
    assert not watched


async def test_no_message_after_a_bye_is_read(line):
    line.hello()
    data = pings(line, 10) + line.client.send(m.Bye())
    line.arrive(data)
    await until(lambda: line.transport.eof)
    assert pings_received(line) == [*range(10)]
    assert line.transport.reading


async def test_more_messages_than_the_rate_allows_wait():
    rates = Rates(client=40.0, identity=1e6, address=1e6, in_all=1e6)
    line = Wire(limit=RateLimit(RateLimits(rates, monotonic), "127.0.0.1"))
    line.hello()
    line.arrive(pings(line, 30))
    for _ in range(3):
        await asyncio.sleep(0)
    assert len(pings_received(line)) in (8, 16)  # the burst of 10, in pieces of 8
    await until(lambda: len(pings_received(line)) == 30, turns=10**7)
    assert pings_received(line) == [*range(30)]
    line.session.connection_lost(None)
    line.transport.socket.close()


async def test_a_lost_connection_is_not_read(line):
    line.hello()
    line.arrive(pings(line, 30))
    line.session.connection_lost(None)
    for _ in range(5):
        await asyncio.sleep(0)
    assert pings_received(line) == [*range(8)]


async def test_a_transport_without_half_close_is_closed_at_the_end(line, monkeypatch):
    closed = []
    monkeypatch.setattr(line.transport, "can_write_eof", lambda: False)
    monkeypatch.setattr(line.transport, "close", lambda: closed.append(True), raising=False)
    line.hello()
    line.session.close(m.Bye())
    assert closed == [True]
    assert not line.transport.eof


@pytest.mark.parametrize("peername", ["a", "/run/a", b"\x00a", b"\x00abc", "", None, ("x", "y", 0)])
async def test_a_client_of_the_unix_socket_may_choose_any_peer_name(peername):
    host, transport = Host(), Transport()
    session = Session(host, 1, Slot("uid 1000", 1000), 1000, FairScheduler(lambda: 0.0))
    transport.peername = peername
    session.connection_made(transport)
    assert (session.address, host.received) == ("uid 1000", ["opened"])
    session.connection_lost(None)
    transport.socket.close()


async def test_a_connection_that_is_lost_before_it_is_made_ends():
    host, transport = Host(), Transport()
    transport.socket.close()
    session = Session(host, 1, Slot("127.0.0.1"), 1000, FairScheduler(lambda: 0.0))
    session.connection_made(transport)
    assert transport.aborted
    session.connection_lost(None)
    assert host.received == ["left: connection lost", "closed"]


async def test_a_hello_does_not_wait_for_messages_of_other_clients_at_its_address():
    allowances = RateLimits(Rates(client=2000.0, identity=1.0, address=1.0, in_all=1.0), lambda: 0.0)
    RateLimit(allowances, "127.0.0.1").spend(1e6, own_limit_only=False)
    line = Wire(limit=RateLimit(allowances, "127.0.0.1"))
    assert line.session.slot.silent
    line.hello()
    assert not line.session.slot.silent
    line.send(m.Ping(time=1.0))
    assert not line.host.received[1:]  # what follows waits
    line.session.connection_lost(OSError("closed"))
    line.transport.socket.close()


async def test_bytes_before_the_hello_count_only_in_the_limit_of_their_connection():
    allowances = RateLimits(Rates(client=2000.0, identity=1e6, address=1e6, in_all=10.0), lambda: 0.0)
    line = Wire(limit=RateLimit(allowances, "127.0.0.1"))
    line.arrive((900_000).to_bytes(4, "big") + bytes(500_000))
    assert RateLimit(allowances, "127.0.0.2").reserve(own_limit_only=False) == 0.0
    line.session.connection_lost(None)
    line.transport.socket.close()


@pytest.mark.parametrize("message", [m.Describe(), m.Sessions()])
async def test_messages_with_large_answers_use_more_of_the_rate_limit(line, message):
    line.hello()
    line.session._connection.push(line.client.send(message))
    cost, _ = line.session._receive_some()
    assert cost >= 20
