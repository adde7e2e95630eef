"""Vectors, checked with this codec and with plain msgpack."""

import json
import math
from pathlib import Path

import jsonschema
import msgpack
import pytest

import armgate.protocol
from armgate.protocol import CODES, DIALECTS, Connection, Refusal, Side, decode, encode
from armgate.protocol import messages as m
from armgate.protocol.codec import MAX_ARRAY_INBOUND
from armgate.protocol.framing import HEADER, frame
from armgate.protocol.spec_statements import statements
from tools.spec.vectors import from_json, to_json

HOME = Path(armgate.protocol.__file__).parent
SCHEMA = json.loads((HOME / "schema.json").read_text(encoding="utf-8"))
CATALOGUES = {"client": DIALECTS[0].client, "server": DIALECTS[0].server}


def load(name):
    return json.loads((HOME / "vectors" / f"{name}.json").read_text(encoding="utf-8"))


def named(name):
    return [pytest.param(vector, id=vector["name"]) for vector in load(name)]


def same(one, other):
    """Return True if both are equal in value and type, including NaN and the sign of zero."""
    if isinstance(one, float) and isinstance(other, float):
        return repr(one) == repr(other)
    if isinstance(one, dict) and isinstance(other, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


# --- round trips ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vector", named("messages"))
def test_the_codec_reads_and_writes_these_bytes(vector):
    payload = bytes.fromhex(vector["hex"])
    message = decode(payload, CATALOGUES[vector["from"]])
    assert same(message.model_dump(exclude_unset=True), from_json(vector["value"]))
    assert encode(message)[HEADER:] == payload


@pytest.mark.parametrize("vector", named("messages"))
def test_plain_msgpack_reads_and_writes_these_bytes(vector):
    payload, value = bytes.fromhex(vector["hex"]), from_json(vector["value"])
    assert same(msgpack.unpackb(payload), value)
    assert msgpack.packb(value) == payload


@pytest.mark.parametrize("vector", named("readable"))
def test_other_encodings_of_a_message_are_read(vector):
    payload, value = bytes.fromhex(vector["hex"]), from_json(vector["value"])
    message = decode(payload, CATALOGUES["client"], MAX_ARRAY_INBOUND)
    assert message == decode(msgpack.packb(value), CATALOGUES["client"])
    assert msgpack.unpackb(payload).items() >= {"type": value["type"]}.items()
    assert msgpack.packb(value) != payload


def test_every_message_has_a_minimal_and_a_complete_vector():
    names = {vector["name"] for vector in load("messages")}
    for message in (*m.CLIENT_MESSAGES, *m.SERVER_MESSAGES):
        kind = message.model_fields["type"].default
        assert {f"{kind}: minimal", f"{kind}: complete"} <= names
    complete = {
        v["name"].partition(":")[0]: v["value"] for v in load("messages") if v["name"].endswith(": complete")
    }
    for message in (*m.CLIENT_MESSAGES, *m.SERVER_MESSAGES):
        kind = message.model_fields["type"].default
        assert complete[kind].keys() == set(message.model_fields)


def test_names_are_unique():
    for name in ("messages", "readable", "invalid", "streams"):
        found = [(vector["name"], vector.get("from")) for vector in load(name)]
        # both sides send bye
        assert len(set(found)) == len(found)


# --- refused ----------------------------------------------------------------------------------------------

HELLO = encode(m.Hello(versions=(1,), name="c"))
WELCOME = m.Welcome(
    version=1, versions=(1,), client_versions=(1,), start="a", session="b", name="c", role="observer",
    limits=m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0),
)  # fmt: skip


def connected(side, state="ready"):
    """Return the receiving side of a connection."""
    if side == "server":  # the server sends, a client receives
        made = Connection(Side.CLIENT)
        made.send(m.Hello(versions=(1,), name="c"))
        made.receive(encode(WELCOME))
        return made
    made = Connection(Side.SERVER)
    if state == "ready":
        made.receive(HELLO)
        made.send(WELCOME)
    return made


@pytest.mark.parametrize("vector", named("invalid"))
def test_invalid_payloads_get_the_error_of_the_vector(vector):
    connection = connected(vector["from"], vector["state"])
    (refusal,) = connection.receive(frame(bytes.fromhex(vector["hex"])))
    error = refusal.error.model_dump(exclude_none=True)
    for key in ("type", "text"):
        del error[key]
    assert error == vector["error"]


@pytest.mark.parametrize("vector", named("invalid"))
def test_plain_msgpack_agrees_on_what_is_well_formed(vector):
    payload = bytes.fromhex(vector["hex"])
    if vector["error"]["code"] != "malformed":
        assert isinstance(msgpack.unpackb(payload), dict)


def test_the_table_of_codes_agrees_with_the_vectors():
    for vector in load("invalid"):
        fatal = CODES[vector["error"]["code"]].fatal or vector["state"] == "await_hello"
        assert vector["error"]["fatal"] is fatal


# --- streams ----------------------------------------------------------------------------------------------


def read_by(connection, pieces):
    found = []
    for item in [x for piece in pieces for x in connection.receive(piece)] + connection.receive_eof():
        if isinstance(item, Refusal):
            found.append({"code": item.error.code, "fatal": item.error.fatal})
        else:
            found.append(item.type)
    return found


@pytest.mark.parametrize("vector", named("streams"))
def test_the_result_of_a_stream_does_not_depend_on_how_it_is_divided(vector):
    pieces = [bytes.fromhex(piece["hex"]) * piece["times"] for piece in vector["pieces"]]
    whole = b"".join(pieces)
    bytewise = (whole[i : i + 1] for i in range(len(whole)))
    for cut in (pieces, [whole], bytewise):
        assert read_by(connected("client"), cut) == vector["events"]


def plainly(stream):
    """Yield the types of the messages before the first framing fault, in a few independent lines."""
    while len(stream) >= 4:
        length = int.from_bytes(stream[:4], "big")
        if not 0 < length <= 65536 or len(stream) < 4 + length:
            return
        try:
            yield msgpack.unpackb(stream[4 : 4 + length])["type"]
        except ValueError:
            return
        stream = stream[4 + length :]


@pytest.mark.parametrize("vector", named("streams"))
def test_a_plain_reader_finds_the_same_messages(vector):
    stream = b"".join(bytes.fromhex(piece["hex"]) * piece["times"] for piece in vector["pieces"])
    expected = [event for event in vector["events"] if isinstance(event, str)]
    found = [kind for kind in plainly(stream) if kind != "tea"]
    assert found[: len(expected)] == expected


# --- agreement --------------------------------------------------------------------------------------------


def test_vectors_refer_to_existing_statements():
    for name in ("readable", "invalid", "streams"):
        for vector in load(name):
            assert vector["statements"]
            assert set(vector["statements"]) <= set(statements()), vector["name"]


def validator(side):
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    part = {"$schema": SCHEMA["$schema"], "$ref": f"#/$defs/{side}", "$defs": SCHEMA["$defs"]}
    return jsonschema.Draft202012Validator(part)


def in_json(value):
    """Return the value in JSON's types: binary data as a text."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {key: in_json(item) for key, item in value.items()}
    return [in_json(item) for item in value] if isinstance(value, list | tuple) else value


def test_the_schema_accepts_every_valid_message():
    checks = {side: validator(side) for side in CATALOGUES}
    for vector in load("messages"):
        checks[vector["from"]].validate(in_json(from_json(vector["value"])))


# JSON does not distinguish 1.0 from 1, has no NaN, and represents binary data as a text. This validator uses
# Python's `$`, which accepts a final line break; that of JSON Schema does not.
BEYOND_JSON = ("nan", "inf", "tick 1.0", "b'", r"\n")


def test_the_schema_refuses_invalid_fields():
    checks = {side: validator(side) for side in CATALOGUES}
    refused = 0
    for vector in load("invalid"):
        if vector["error"]["code"] != "invalid_message" or any(x in vector["name"] for x in BEYOND_JSON):
            continue
        value = in_json(msgpack.unpackb(bytes.fromhex(vector["hex"])))
        assert not checks[vector["from"]].is_valid(value), vector["name"]
        refused += 1
    assert refused > 80


@pytest.mark.parametrize(
    "value",
    [None, True, 0, -1, 2**53, 2**53 + 1, 2**64 - 1, 0.5, math.nan, -math.inf, -0.0, "$x", b"\x00", [[]]],
)
def test_values_survive_json(value):
    expected = json.loads(json.dumps(to_json({"a": [value]}), allow_nan=False))
    assert same(from_json(expected), {"a": [value]})
