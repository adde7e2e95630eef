"""Codec of messages: round trips, and the errors of invalid payloads."""

import contextlib
import re

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armgate.protocol import LocalProtocolError, ProtocolError, RemoteProtocolError, decode, encode, with_re
from armgate.protocol import messages as m
from armgate.protocol.codec import MAX_ARRAY, MAX_ARRAY_INBOUND, MAX_DEPTH, MAX_MAP, MAX_STR, _bounds, unpack
from armgate.protocol.fault_location import Reader, fault_in
from armgate.protocol.framing import HEADER, frame
from support.messages import FROM_CLIENT, FROM_SERVER

COMMAND = {"type": "command", "robot": "FR", "fence": 1, "seq": 7, "tick": 3, "dq": [0.1, 0.2]}
EVERY = [(model, m.Catalogue.client, s) for model, s in FROM_CLIENT.items()]
EVERY += [(model, m.Catalogue.server, s) for model, s in FROM_SERVER.items()]


def refused(payload, catalogue=m.Catalogue.client, **more):
    with pytest.raises(RemoteProtocolError) as caught:
        decode(payload, catalogue, **more)
    return caught.value


def fields_given(model):
    """Return the fields set in a message and its parts; as a text, so that NaN equals itself."""
    return repr({"type": model.type, **model.model_dump(exclude_unset=True)})


@pytest.mark.daily(8)
@pytest.mark.parametrize(("model", "catalogue", "strategy"), EVERY, ids=lambda x: getattr(x, "__name__", ""))
def test_every_message_survives_a_round_trip_with_exactly_its_set_fields(model, catalogue, strategy):
    @settings(
        max_examples=30,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(strategy)
    def run(message):
        payload = encode(message)[HEADER:]
        back = decode(payload, catalogue)
        assert type(back) is model
        assert fields_given(back) == fields_given(message)
        assert encode(back)[HEADER:] == payload

    run()


@pytest.mark.parametrize("re", [0, 127, 2**31 - 1])
def test_re_is_added_to_an_encoded_answer(re):
    small = m.Signaled(name="x")
    assert with_re(encode(small), re) == encode(m.Signaled(name="x", re=re))
    counts = {f"a{number}": number for number in range(16)}
    large = frame(msgpack.packb({"type": "signaled", "name": "x", **counts}))
    assert unpack(with_re(large, re)[HEADER:]) == {"type": "signaled", "re": re, "name": "x", **counts}


def test_an_absent_holder_differs_from_nil():
    absent = m.Entry(robot="FR", tick=1, time=0.0)
    nobody = m.Entry(robot="FR", tick=1, time=0.0, holder=None)
    state = m.State(robot="FR", tick=1, time=0.0, entries=(absent, nobody))
    back = decode(encode(state)[HEADER:], m.Catalogue.server)
    assert ["holder" in entry.model_fields_set for entry in back.entries] == [False, True]


def test_type_is_always_encoded_and_defaults_are_not():
    assert unpack(encode(m.Describe())[HEADER:]) == {"type": "describe"}
    assert unpack(encode(m.Ping(time=1))[HEADER:]) == {"type": "ping", "time": 1.0}


def test_keys_of_a_later_version_are_ignored():
    message = decode(msgpack.packb(COMMAND | {"wind": {"from": "north"}}), m.Catalogue.client)
    assert message == m.Command(**COMMAND | {"dq": (0.1, 0.2)})


def test_an_integer_is_accepted_as_a_number():
    message = decode(msgpack.packb(COMMAND | {"dq": [1, -(2**63), 2**64 - 1]}), m.Catalogue.client)
    assert message.dq == (1.0, -(2.0**63), 2.0**64)
    assert all(type(x) is float for x in message.dq)


# --- well-formed payloads that are not valid messages ------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"dq": [0.0, True]}, r"command\.dq\[1\]: .*got a bool True"),
        ({"dq": ["0.1"]}, r"command\.dq\[0\]: .*got a text '0\.1'"),
        ({"dq": [None]}, r"command\.dq\[0\]: .*got nil"),
        ({"dq": [[0.1]]}, r"command\.dq\[0\]: .*got an array"),
        ({"dq": 0.1}, r"command\.dq: .*got a number 0\.1"),
        ({"dq": {"a": 1}}, r"command\.dq: .*got a map"),
        ({"dq": b"\0"}, r"command\.dq: .*got binary data"),
        ({"dq": [0.0] * 65}, r"command\.dq: expected at most 64 items; got an array at byte \d+"),
        ({"fence": 2**63}, r"command\.fence: expected less than 9223372036854775808; got an integer 92"),
        ({"robot": "F R"}, r"command\.robot: .*got a text 'F R'"),
        ({"robot": b"FR"}, r"command\.robot: .*got binary data"),
        ({"robot": "x" * 65}, r"command\.robot: "),
        ({"fence": -1}, r"command\.fence: .*got an integer -1"),
        ({"tick": 1.0}, r"command\.tick: .*got a number 1\.0"),
        ({"deadline": float("nan")}, r"command\.deadline: .*finite.*got a number nan"),
        ({"fence": 1.5, "tick": "x"}, r"command\.fence: .*\(and 1 more\)"),
    ],
)
def test_an_invalid_field_is_named_and_seq_is_repeated(change, text):
    error = refused(msgpack.packb(COMMAND | change))
    assert (error.code, error.fatal, error.about, error.seq) == ("invalid_message", False, "command", 7)
    assert re.search(text, error.text), error.text


@given(st.binary(max_size=60))
def test_the_slow_reader_locates_a_fault_in_every_payload_that_the_fast_reader_refuses(payload):
    slow, refused = fault_in(payload, _bounds(MAX_ARRAY)), False
    try:
        unpack(payload)
    except RemoteProtocolError:
        refused = True
    assert slow.startswith("byte ") == refused, slow


WRONG = (
    None,
    True,
    -1,
    2**64 - 1,
    1.5,
    float("nan"),
    "",
    "x y",
    "x" * 600,
    b"\0",
    [],
    [None] * 100,
    {},
    {"a": 1},
)


@pytest.mark.parametrize("model", m.CLIENT_MESSAGES, ids=lambda x: x.__name__)
def test_errors_of_every_field_name_its_place_and_no_library(model):
    kind = model.model_fields["type"].default
    for field in model.model_fields.keys() - {"type"}:
        for value in WRONG:
            payload = msgpack.packb({"pad": 1, "type": kind, field: value})
            with contextlib.suppress(RemoteProtocolError):
                decode(payload, m.Catalogue.client)
                continue
            text = refused(payload).text
            assert not FOREIGN.search(text.replace(kind, "").replace(field, "")), text
            assert re.match(rf"{kind}\.\w+(\[\d+\])?: (is missing|expected .+; got )", text), text


def test_the_reported_byte_is_the_first_of_the_value():
    payload = msgpack.packb({"type": "subscribe", "robots": ["A", "B", 7], "every": 1})
    text = refused(payload).text
    assert text == "subscribe.robots[2]: expected a text; got an integer 7 at byte 28"
    assert payload[28] == 7


NEAR = {"type": "stop", "robot": 5, "pad": [[1] * 250] * 250}
FAR = {"type": "stop", "pad": [[1] * 250] * 250, "robot": 5}


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (msgpack.packb(NEAR), r"stop\.robot: .*at byte 17"),
        (msgpack.packb(FAR), r"stop\.robot: expected a text; got an integer 5"),
        (msgpack.packb(FAR)[:-1] + b"\xc1", "the payload is not a map of this protocol"),
    ],
    ids=["near", "far", "malformed"],
)
def test_the_second_pass_reads_a_bounded_number_of_values(payload, text, monkeypatch):
    read = []
    head = Reader._head
    monkeypatch.setattr(Reader, "_head", lambda self: read.append(1) or head(self))
    assert re.fullmatch(text, refused(payload).text)
    assert len(read) < 200


def test_a_missing_field_is_named():
    error = refused(msgpack.packb({k: v for k, v in COMMAND.items() if k != "dq"}))
    assert error.text == "command.dq: is missing"


@pytest.mark.parametrize("seq", [True, "7", 7.0, -1, 2**63, None])
def test_an_invalid_seq_is_not_repeated(seq):
    assert refused(msgpack.packb(COMMAND | {"seq": seq})).seq is None


@pytest.mark.parametrize(("id_", "echoed"), [(5, 5), (True, None), (2**31, None), ("5", None)])
def test_the_id_of_a_request_is_repeated_if_it_is_valid(id_, echoed):
    assert refused(msgpack.packb({"type": "ping", "time": "x", "id": id_})).re == echoed
    assert refused(msgpack.packb({"type": "tea", "id": id_})).re == echoed


def test_an_unknown_type_is_not_fatal_and_names_the_known_ones():
    error = refused(msgpack.packb({"type": "tea"}))
    assert (error.code, error.fatal, error.about) == ("unknown_type", False, "tea")
    assert "'tea'" in error.text
    assert "command" in error.text
    assert refused(msgpack.packb({"type": "state"})).code == "unknown_type"


@pytest.mark.parametrize("kind", [None, 3, ["hello"], b"hello", {}])
def test_a_type_that_is_not_a_text_is_not_fatal(kind):
    error = refused(msgpack.packb({"type": kind}))
    assert (error.code, error.fatal, error.about) == ("invalid_message", False, None)


def test_no_error_contains_the_token():
    hello = {"type": "hello", "versions": [1], "name": "c"}
    for token in ("hunter2" * 50, b"hunter2", ["hunter2"], {"hunter2": "hunter2"}, ""):
        error = refused(msgpack.packb(hello | {"token": token}))
        assert "hunter2" not in error.text
        assert "hello.token" in error.text


@given(st.text(max_size=2000), st.text(max_size=2000))
def test_error_texts_are_bounded_for_any_input(kind, robot):
    for payload in (msgpack.packb({"type": kind}), msgpack.packb(COMMAND | {"robot": robot + " "})):
        error = refused(payload)
        assert len(error.text) <= 512
        decode(encode(error.message())[HEADER:], m.Catalogue.server)


# --- malformed payloads ------------------------------------------------------------------------------------


def nested(levels):
    return b"\x91" * levels + b"\x01"


MALFORMED = {
    "nothing": (b"", "byte 0: the payload ends inside this value"),
    "half a map": (b"\x82\xa1a\x01", "byte 4: the payload ends inside this value"),
    "half a text": (b"\x81\xa1a\xa5bc", "byte 3: the payload ends inside this value"),
    "more than one value": (
        msgpack.packb({}) + b"\x01",
        "byte 1: expected the end of the payload, got 1 bytes",
    ),
    "a byte that is reserved": (b"\xc1", "byte 0: no msgpack value begins with the byte 0xc1"),
    "no map": (msgpack.packb([1, 2]), "byte 0: expected a map, got an array"),
    "a number": (b"\x01", "byte 0: expected a map, got an integer"),
    "not UTF-8": (b"\x81\xa1a\xa1\xff", "byte 3: a text that is not UTF-8"),
    "key not UTF-8": (b"\x81\xa1\xff\x01", "byte 1: a text that is not UTF-8"),
    "a key twice": (b"\x82\xa1a\x01\xa1a\x02", "byte 4: a key occurs twice"),
    "a key twice inside": (b"\x81\xa1m\x82\xa1a\x01\xa1a\x02", "byte 7: a key occurs twice"),
    "an integer as key": (b"\x81\x01\x02", "byte 1: a key of a map is not a text"),
    "binary data as key": (b"\x81\xc4\x01a\x02", "byte 1: a key of a map is not a text"),
    "an array as key": (b"\x81\x91\x01\x02", "byte 1: a key of a map is not a text"),
    "extension": (b"\x81\xa1a\xd4\x05\x00", "byte 3: a value of an extension type"),
    "extension of length 0": (b"\x81\xa1a\xc7\x00\x05", "byte 3: a value of an extension type"),
    "timestamp": (b"\x81\xa1a\xd6\xff\x00\x00\x00\x01", "byte 3: a value of an extension type"),
    "too deep": (b"\x81\xa1a" + nested(MAX_DEPTH), "byte 10: nested deeper than 8"),
    "beyond the depth limit of msgpack": (b"\x81\xa1a" + nested(5000), "byte 10: nested deeper than 8"),
    "map of 2**32 - 1": (b"\xdf\xff\xff\xff\xff", "byte 0: a map of 4294967295 items; at most 128"),
    "array of 2**32 - 1": (b"\x81\xa1a\xdd\xff\xff\xff\xff", "byte 3: an array of 4294967295 items"),
    "text of 2**32 - 1": (
        b"\x81\xa1a\xdb\xff\xff\xff\xff",
        "byte 3: a text of 4294967295 bytes; at most 4096",
    ),
    "map too large": (msgpack.packb({str(i): 0 for i in range(MAX_MAP + 1)}), "byte 0: a map of 129 items"),
    "array too long": (msgpack.packb({"a": [0] * (MAX_ARRAY + 1)}), "byte 3: an array of 4097 items"),
    "text too long": (msgpack.packb({"a": "x" * (MAX_STR + 1)}), "byte 3: a text of 4097 bytes"),
    "binary data too long": (
        msgpack.packb({"a": b"x" * (m.MAX_CHUNK + 1)}),
        "byte 3: binary data of 262145 bytes",
    ),
}

FOREIGN = re.compile(
    r"Input should|validation|Tuple|String should|pydantic|Stack|strict|NoneType|Extra|Field req|max_|ext_"
)
"""Words of libraries and names of their options, which must not appear in error texts."""


@pytest.mark.parametrize(("payload", "text"), list(MALFORMED.values()), ids=list(MALFORMED))
def test_malformed_payloads_are_fatal(payload, text):
    error = refused(payload)
    assert (error.code, error.fatal) == ("malformed", True)
    assert error.text.startswith(text), error.text
    assert not FOREIGN.search(error.text)


def test_values_at_the_bounds_are_accepted():
    at_bounds = {
        "deep": b"\x81\xa1a" + b"\x91" * (MAX_DEPTH - 1) + b"\x01",
        "map": msgpack.packb({str(i): 0 for i in range(MAX_MAP)}),
        "array": msgpack.packb({"a": [0] * MAX_ARRAY}),
        "text": msgpack.packb({"a": "x" * MAX_STR}),
    }
    for payload in at_bounds.values():
        unpack(payload)


def test_arrays_from_clients_have_a_smaller_bound_than_those_to_clients():
    payload = msgpack.packb(COMMAND | {"more": [0] * (MAX_ARRAY_INBOUND + 1)})
    assert decode(payload, m.Catalogue.client).seq == 7
    assert refused(payload, max_array=MAX_ARRAY_INBOUND).code == "malformed"


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)


@given(st.binary(max_size=400))
def test_any_bytes_give_a_message_or_a_protocol_error(payload):
    for catalogue in (m.Catalogue.client, m.Catalogue.server):
        try:
            decode(payload, catalogue)
        except ProtocolError as error:
            encode(error.message())


@given(st.sampled_from(sorted(m.Catalogue.client | m.Catalogue.server)), st.data())
def test_any_values_in_any_field_give_a_message_or_a_protocol_error(kind, data):
    for catalogue in (m.Catalogue.client, m.Catalogue.server):
        names = [*catalogue[kind].model_fields] if kind in catalogue else ["a"]
        fields = data.draw(st.dictionaries(st.sampled_from(names), VALUES, max_size=6))
        try:
            decode(msgpack.packb({**fields, "type": kind}), catalogue)
        except ProtocolError as error:
            encode(error.message())


@given(st.sampled_from([*FROM_CLIENT.values()]).flatmap(lambda s: s), st.data())
def test_a_message_with_one_byte_changed_gives_a_message_or_a_protocol_error(message, data):
    payload = bytearray(encode(message)[HEADER:])
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        decode(bytes(payload), m.Catalogue.client)
    except ProtocolError as error:
        encode(error.message())


# --- faults of the sender ----------------------------------------------------------------------------------


def test_a_value_that_cannot_be_encoded_is_a_local_error():
    for dq in ((object(),), (2**64,), (1 + 2j,), ("\ud800",)):
        message = m.Command.model_construct(robot="FR", fence=1, seq=1, tick=1, dq=dq)
        with pytest.raises(LocalProtocolError, match="command: cannot be encoded") as caught:
            encode(message)
        assert caught.value.about == "command"


def test_a_message_beyond_the_limit_is_a_local_error():
    with pytest.raises(LocalProtocolError, match=r"chunk: .*at most 100"):
        encode(m.Chunk(hash="0" * 64, offset=0, total=1, data=b"x" * 100), limit=100)


def test_the_largest_chunk_fits_into_a_frame():
    chunk = m.Chunk(re=2**31 - 1, hash="0" * 64, offset=2**63 - 1, total=2**63 - 1, data=bytes(m.MAX_CHUNK))
    assert decode(encode(chunk)[HEADER:], m.Catalogue.server) == chunk
