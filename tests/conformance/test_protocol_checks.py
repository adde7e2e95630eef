"""Checks of the kit on the bytes and messages of a server."""

import msgpack
import pytest

from armgate.conformance.codec import FrameReader, Malformed, frame, pack, unpack
from armgate.conformance.command_log import CommandLog, VerdictTracker
from armgate.conformance.message_schema import MAPS, MESSAGES, schema_errors
from armgate.protocol import messages as m
from support.messages import FROM_SERVER

VERDICT = {
    "type": "verdict", "robot": "R", "seq": 1, "tick": 5, "target": 6, "outcome": "admitted", "beta": 1.0,
    "dq": [0.1], "setpoint": [0.2],
}  # fmt: skip


def test_payloads_do_not_depend_on_how_the_stream_is_split():
    stream = b"".join(pack({"type": "bye", "reason": "x" * n}) for n in range(20))
    reader = FrameReader()
    found = [payload for i in range(len(stream)) for payload in reader.feed(stream[i : i + 1])]
    assert found == FrameReader().feed(stream)
    assert len(found) == 20
    assert reader.pending == 0


@pytest.mark.parametrize("data", [b"\x00\x00\x00\x00", b"\x00\x10\x00\x01"])
def test_a_forbidden_frame_of_a_server_is_an_error(data):
    with pytest.raises(Malformed):
        FrameReader().feed(data)


@pytest.mark.parametrize(
    "payload",
    [
        b"\xc1",
        msgpack.packb([1]),
        b"\x82\xa1a\x01\xa1a\x02",
        b"\x81\x01\x01",
        msgpack.packb({"a": msgpack.ExtType(1, b"x")}),
        msgpack.packb({"a": float("nan")}),
        msgpack.packb({"a": [[[[[[[[1]]]]]]]]}),
        msgpack.packb({"a": "x" * 4097}),
        msgpack.packb({str(i): i for i in range(129)}),
    ],
)
def test_a_forbidden_payload_of_a_server_is_an_error(payload):
    with pytest.raises(Malformed):
        unpack(payload)


@pytest.mark.parametrize("model", m.SERVER_MESSAGES, ids=lambda model: model.__name__)
def test_the_kits_own_schema_covers_every_message_of_the_protocol(model):
    schema = MESSAGES[model.model_fields["type"].default]
    keys = {part.partition(":")[0] for part in schema.split()}
    fields = {name: field.is_required() for name, field in model.model_fields.items() if name != "type"}
    assert keys == {name if needed else f"{name}?" for name, needed in fields.items()}


def test_the_schema_accepts_all_messages_of_the_protocol():
    from hypothesis import given, settings
    from hypothesis import strategies as st

    @settings(max_examples=150, deadline=None)
    @given(st.one_of(*FROM_SERVER.values()))
    def accepted(message):
        fields = {"type": message.type, **message.model_dump(exclude_unset=True)}
        assert not list(schema_errors(unpack(msgpack.packb(fields))))

    accepted()


@pytest.mark.parametrize(
    "change",
    [
        {"seq": "1"},
        {"seq": -1},
        {"seq": True},
        {"target": "6"},
        {"outcome": "perhaps"},
        {"beta": 1.5},
        {"dq": 0.1},
        {"dq": ["0.1"]},
        {"robot": "a b"},
        {"reasons": [{"cause": "fence"}]},
        {"reasons": [7]},
        {"type": 5},
    ],
)
def test_the_schema_rejects_invalid_messages(change):
    assert not list(schema_errors(VERDICT))
    assert list(schema_errors(VERDICT | change))
    assert "Reason" in MAPS


class Tracked:
    """Verdict tracker after some commands, and the violations that it finds."""

    def __init__(self, *seqs):
        self.verdicts = VerdictTracker(CommandLog())
        for seq in seqs:
            self.verdicts.note_sent({"type": "command", "robot": "R", "seq": seq})

    def verdict(self, seq):
        return list(self.verdicts.note_received(VERDICT | {"seq": seq}))


def test_each_command_is_answered_once_and_in_order():
    tracked = Tracked(1, 2, 3)
    assert tracked.verdict(1) == []
    assert list(tracked.verdicts.note_received({"type": "error", "seq": 2})) == []
    assert tracked.verdict(3) == []
    assert tracked.verdicts.unanswered == []
    assert "second answer" in tracked.verdict(3)[0]
    assert "no such command" in tracked.verdict(9)[0]


def test_a_verdict_out_of_order_and_one_that_never_comes_are_found():
    tracked = Tracked(1, 2)
    assert "before that of seq 1" in tracked.verdict(2)[0]
    assert tracked.verdicts.unanswered == [("R", 1)]


def test_a_state_that_applies_a_command_before_its_verdict_is_found():
    tracked = Tracked(1)
    state = {"type": "state", "robot": "R", "tick": 7, "entries": [{"robot": "R", "applied_seq": 1}]}
    assert "before its verdict" in next(tracked.verdicts.note_received(state))
    tracked.verdict(1)
    assert list(tracked.verdicts.note_received(state)) == []
    assert "came after" in next(tracked.verdicts.note_received(state | {"tick": 6}))


def test_a_frame_begins_with_its_length():
    assert frame(b"abc") == b"\x00\x00\x00\x03abc"
