"""Codec of recordings: exact to the last bit, and valid by the schemas."""

import dataclasses
import json
import math
import struct

import hypothesis.strategies as st
import jsonschema
import pytest
from hypothesis import given

from armgate import events as e
from armgate.protocol import messages as m
from armgate.recording import CellState, Gap, LogLine, RobotState, Step
from armgate.recording.codec import decode, encode
from armgate.recording.topics import EVENTS, OUTPUTS, schema_of

numbers = st.floats()
joints = st.lists(numbers, min_size=1, max_size=9).map(tuple)
counts = st.integers(-1, 2**53)
texts = st.text(max_size=20)
points = st.tuples(numbers, numbers, numbers)
keys = st.builds(e.PlanKey, texts, counts, counts, counts)
reasons = st.builds(
    e.Reason,
    st.sampled_from(e.Cause), texts, st.none() | texts, st.none() | st.tuples(texts, texts),
    st.none() | numbers, st.none() | numbers, st.none() | st.tuples(points, points),
)  # fmt: skip
events = st.one_of(
    st.builds(
        e.Tick, texts, counts, numbers, joints, joints, joints, st.none() | keys, counts, st.booleans()
    ),
    st.builds(e.Command, texts, counts, counts, counts, joints),
    st.builds(e.PlanAnswer, texts, keys, st.booleans(), texts),
    st.builds(e.LeaseChange, texts, st.none() | counts, numbers),
    st.builds(e.Stop, st.lists(texts).map(tuple), texts, texts),
    st.builds(e.Reset, counts, texts),
    st.builds(e.LinkChange, texts, st.sampled_from(e.LinkState), texts),
)
outputs = st.one_of(
    st.builds(
        e.Verdict,
        texts, counts, counts, st.none() | counts, st.sampled_from(e.Outcome), numbers, joints, joints,
        st.lists(reasons, max_size=3).map(tuple),
    ),
    st.builds(e.Plan, texts, keys, counts, st.lists(joints, max_size=3).map(tuple)),
    st.builds(e.Stopped, counts, st.lists(texts).map(tuple), texts, texts),
    st.builds(e.ResetAnswer, counts, st.booleans(), texts),
    st.builds(e.Rebase, texts, joints, counts),
)  # fmt: skip


def bits(value):
    """Return the value with every float as its bits: NaN equals NaN, 0.0 differs from -0.0."""
    if isinstance(value, float):
        return ("nan",) if math.isnan(value) else struct.pack("<d", value)
    if dataclasses.is_dataclass(value):
        return type(value), [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    return [bits(part) for part in value] if isinstance(value, tuple) else (type(value), value)


@given(events, st.lists(outputs, max_size=3).map(tuple))
def test_an_event_and_its_outputs_survive_a_round_trip_to_the_last_bit(event, given):
    topic, data = encode(Step(event, given))
    back = decode(topic, data)
    assert bits(back.event) == bits(event)
    assert bits(tuple(back.outputs)) == bits(given)
    assert b"NaN," not in data.replace(b'"NaN",', b"")  # valid JSON has no bare NaN
    json.loads(data, parse_constant=pytest.fail)


def test_every_event_and_output_has_a_topic():
    assert set(EVENTS.values()) == set(e.GateEvent.__args__)
    assert set(OUTPUTS.values()) == set(e.GateOutput.__args__)


SIGNAL = m.SignalValue(owner="x", value=(1.0, 2.0), time=0.5)
VERDICT = e.Verdict("A", 2, 3, 4, e.Outcome.ADMITTED, 1.0, (0.1,), (0.2,))
ITEMS = [
    Step(e.Command("A", 1, 2, 3, (0.1,)), (VERDICT,)),
    RobotState(m.Entry(robot="A", tick=3, time=0.5, q=(0.1,), nearest=(), counts={"admitted": 3})),
    CellState(0.5, 7, {"A": 3}, {"s": SIGNAL}, ("late",)),
    CellState(0.5, None, {}, {}, ()),
    LogLine(1.5, "warning", "stopped", {"stop": 1, "robots": ["A"]}),
    Gap(7, 3),
]  # fmt: skip


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: type(item).__name__)
def test_every_item_survives_a_round_trip_and_fits_its_schema(item):
    topic, data = encode(item)
    assert decode(topic, data) == item
    name, schema = schema_of(topic)
    assert name
    jsonschema.validate(json.loads(data), json.loads(schema))


def test_a_command_of_an_earlier_version_has_its_refusal_in_the_fence():
    data = b'{"event":{"robot":"A","fence":-1,"seq":2,"based_on":3,"dq":[0.1]},"outputs":[]}'
    assert decode("/gate/command", data) == Step(e.Command("A", -1, 2, 3, (0.1,), holder=True), ())


@pytest.mark.parametrize("topic", ["/gate/later", "/later"])
def test_topics_of_a_later_version_are_ignored(topic):
    assert decode(topic, b"{}") is None


@pytest.mark.parametrize(
    ("topic", "data"),
    [
        ("/gate/tick", b"{}"), ("/gate/tick", b"["), ("/gate/tick", b'{"event":{},"outputs":[]}'),
        ("/gate/reset", b'{"event":{"stop":1,"by":"x"},"outputs":[{"later":{}}]}'),
        ("/robots/A/state", b"{}"), ("/state", b"{}"), ("/state", b"[]"), ("/log", b"{}"), ("/gap", b"7"),
    ],
)  # fmt: skip
def test_a_message_without_the_form_of_its_topic_is_refused(topic, data):
    with pytest.raises(ValueError, match=topic):
        decode(topic, data)
