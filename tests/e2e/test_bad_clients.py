"""Answers of a daemon to bad clients, while another client keeps moving its robot."""

import math
import struct

import msgpack
import pytest
import pytest_asyncio

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import Mover, Process, Raw

pytestmark = pytest.mark.asyncio(loop_scope="module")


def framed(payload):
    return struct.pack(">I", len(payload)) + payload


def packed(**fields):
    return framed(msgpack.packb(fields))


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def served(tmp_path_factory):
    """A daemon with a controller that keeps moving robot B."""
    file = tmp_path_factory.mktemp("served") / "arms.yaml"
    file.write_text(arms_yaml(max_age_ticks=1000))
    async with Process.serving(file) as daemon:
        mover = await Mover.start(daemon.port, "B")
        yield daemon, mover
        await mover.stop()


def command(**fields):
    sound = {"type": "command", "robot": "A", "fence": 1, "seq": 7, "tick": 0, "dq": [0.0, 0.0, 0.0]}
    return packed(**(sound | fields))


UNREADABLE = {
    "bool in dq": (command(dq=[True, 0.0, 0.0]), "dq"),
    "text in dq": (command(dq=["0.1", 0.0, 0.0]), "dq"),
    "nil in dq": (command(dq=[None, 0.0, 0.0]), "dq"),
    "dq is a text": (command(dq="0.1"), "dq"),
    "65 joints": (command(dq=[0.0] * 65), "dq"),
    "a robot that is a number": (command(robot=3), "robot"),
}


@pytest.mark.daily(3)
@pytest.mark.parametrize("case", UNREADABLE)
async def test_a_command_that_cannot_be_read_is_an_error_with_its_seq(served, case):
    daemon, mover = served
    data, field = UNREADABLE[case]
    bad = await Raw.hello(daemon.port, "bad")
    bad.send_bytes(data)
    error = await bad.get(m.Error)
    assert (error.code, error.fatal, error.about, error.seq) == ("invalid_message", False, "command", 7)
    assert field in error.text
    bad.send(m.Ping(time=1.0))
    await bad.get(m.Pong)
    await mover.moves_on()


@pytest.mark.parametrize(
    ("fields", "code", "seq"),
    [
        ({"robot": "C"}, "unknown_robot", 7),
        ({"type": "leap"}, "unknown_type", None),
    ],
)
async def test_an_unknown_message_type_is_an_error(served, fields, code, seq):
    daemon, mover = served
    bad = await Raw.hello(daemon.port, "bad")
    bad.send_bytes(command(**fields))
    error = await bad.get(m.Error)
    assert (error.code, error.fatal, error.seq) == (code, False, seq)
    await mover.moves_on()


@pytest.mark.parametrize(
    ("dq", "cause"),
    [
        ([0.0], "length"),
        ([0.0] * 4, "length"),
        ([], "length"),
        ([math.nan, 0.0, 0.0], "not_finite"),
        ([math.inf, 0.0, 0.0], "not_finite"),
        ([-math.inf, 0.0, 0.0], "not_finite"),
    ],
)
async def test_a_readable_command_gets_its_verdict(served, dq, cause):
    daemon, mover = served
    bad = await Raw.hello(daemon.port, "bad")
    fence = await bad.acquire("A")
    bad.send(m.Subscribe(robots=("A",)))
    state = await bad.get(m.State)
    bad.send_bytes(command(fence=fence, tick=state.tick, dq=dq))
    verdict = await bad.get(m.Verdict)
    assert (verdict.seq, verdict.outcome, verdict.reasons[0].cause) == (7, "refused", cause)
    bad.send(m.Release(robot="A", fence=fence))
    await bad.get(m.Lease, lambda lease: lease.state == "released")
    await mover.moves_on()


FATAL = {
    "garbage": (b"GET / HTTP/1.1\r\n\r\n", "frame_too_large"),
    "4 GiB": (b"\xff\xff\xff\xff", "frame_too_large"),
    "64 KiB and one byte": (struct.pack(">I", 65537), "frame_too_large"),
    "an empty frame": (b"\x00\x00\x00\x00", "empty_frame"),
    "no msgpack": (framed(b"\xc1\xc1\xc1"), "malformed"),
    "no map": (framed(msgpack.packb([1, 2])), "malformed"),
    "a key twice": (framed(b"\x82\xa4type\xa4ping\xa4type\xa4ping"), "malformed"),
    "an extension": (framed(msgpack.packb({"type": msgpack.ExtType(4, b"x")})), "malformed"),
    "far too deep": (framed(b"\x81\xa4type" + b"\x91" * 500 + b"\x00"), "malformed"),
    "a second hello": (packed(type="hello", versions=[1], name="bad"), "unexpected"),
}


@pytest.mark.parametrize("case", FATAL)
async def test_a_violation_of_the_protocol_ends_the_connection_with_an_error_code(served, case):
    daemon, mover = served
    data, code = FATAL[case]
    bad = await Raw.hello(daemon.port, "bad")
    bad.send_bytes(data)
    errors = [x for x in await bad.rest() if isinstance(x, m.Error)]
    assert [(error.code, error.fatal) for error in errors] == [(code, True)]
    await mover.moves_on()


BEFORE_HELLO = {
    "an unknown version": (packed(type="hello", versions=[99], name="bad"), "version"),
    "something else first": (packed(type="ping", time=1.0), "unexpected"),
    "more than 4 KiB": (struct.pack(">I", 4097), "frame_too_large"),
    "a nameless hello": (packed(type="hello", versions=[1]), "invalid_message"),
}


@pytest.mark.parametrize("case", BEFORE_HELLO)
async def test_before_hello_every_violation_ends_the_connection(served, case):
    daemon, mover = served
    data, code = BEFORE_HELLO[case]
    bad = await Raw.open(daemon.port)
    bad.send_bytes(data)
    (error,) = await bad.rest()
    assert (error.code, error.fatal) == (code, True)
    await mover.moves_on()


async def test_a_flood_of_half_messages_and_resets_disturbs_no_other_client(served):
    daemon, mover = served
    for _ in range(30):
        bad = await Raw.hello(daemon.port, "bad")
        bad.send_bytes(command()[:9])
        await bad.writer.drain()
        bad.writer.transport.abort()
    await mover.moves_on(20)
