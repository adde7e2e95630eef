"""Messages of the robot server's socket are decoded exactly; all other bytes are an error."""

import math
import struct

import msgpack
import pytest

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.robot_server.codec import LARGEST, CodecError, Decoder, encode
from armgate.links.robot_server.connection import TIMEOUT, PeerTimeout
from armgate.links.robot_server.messages import (
    FORMAT,
    Heartbeat,
    Hello,
    Refusal,
    ResumePoint,
    TickReport,
    Welcome,
)

KEY = PlanKey("s", 2, 7, -1)
TICK = Tick("A", 7, 0.1 + 0.2, (1.0, -0.0), (5e-324, 2.0), (0.0, 0.0), KEY, 0, True)
MESSAGES = [
    Hello(FORMAT, "hash", "s", (ResumePoint("A", 0, 0), ResumePoint("B", 7, 2))),
    Welcome(FORMAT),
    Refusal("why"),
    Heartbeat(),
    TickReport(TICK, 2, 14),
    TickReport(Tick("A", 0, 0.0, (), (), ()), 0, 0),
    LinkChange("A", LinkState.LOST, "cable"),
    PlanAnswer("A", KEY, False, "late"),
    Plan("A", KEY, 3, ((0.1, 0.2), (0.0, 0.0))),
    Rebase("A", (0.1, 0.2), 3),
]


def test_every_message_is_decoded_unchanged_from_pieces_of_any_size():
    data = b"".join(map(encode, MESSAGES))
    for size in (1, 3, 1000, len(data)):
        decoder, found = Decoder(), []
        for at in range(0, len(data), size):
            found += decoder.push(data[at : at + size])
        assert found == MESSAGES
        assert math.copysign(1.0, found[4].event.q[1]) == -1.0


def packed(*values):
    body = msgpack.packb(list(values))
    return struct.pack(">I", len(body)) + body


@pytest.mark.parametrize(
    "data",
    [
        packed(),
        packed("nothing"),
        packed(["beat"]),
        packed("beat", 1),
        packed("welcome", "1"),
        packed("welcome", True),
        packed("rebase", "A", [0.1, math.nan], 1),
        packed("rebase", "A", [0.1, math.inf], 1),
        packed("rebase", "A", [0.1, 1], 1),
        packed("rebase", "A", 0.1, 1),
        packed("rebase", 3, [0.1], 1),
        packed("change", "A", "gone", ""),
        packed("answer", "A", ["s", 2, 7], True, ""),
        packed("answer", "A", ["s", 2, 7.0, -1], True, ""),
        packed("played", ["A", 0, 0.0, [], [], [], None, -1, False], 0),
        struct.pack(">I", 3) + b"\xc1\xc1\xc1",
        struct.pack(">I", LARGEST + 1),
    ],
)
def test_any_other_bytes_are_an_error(data):
    with pytest.raises(CodecError):
        Decoder().push(data)


def test_another_format_is_named_with_any_fields():
    with pytest.raises(CodecError, match=f"format 99.*expected {FORMAT}"):
        Decoder().push(packed("hello", 99, {"all": "new"}))


def test_a_silent_peer_times_out_but_not_right_after_a_pause_of_this_process():
    other = PeerTimeout(0.0)
    for tenth in range(10):
        assert not other.expired(0.1 * tenth)
    other.received(0.9)
    assert not any(other.expired(0.9 + 0.4 * part) for part in (1, 2))
    assert not other.expired(0.9 + TIMEOUT)
    assert other.expired(1.0 + TIMEOUT)
    asleep = PeerTimeout(0.0)
    assert not asleep.expired(60.0)
    assert not asleep.expired(60.0 + 0.4 * TIMEOUT)
    assert asleep.expired(60.0 + 0.6 * TIMEOUT)
