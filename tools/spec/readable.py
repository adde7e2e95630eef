"""Payloads in encodings that armgate does not write, but every receiver must read."""

import struct
from collections.abc import Iterator
from typing import Any

import msgpack

from tools.spec.examples import AT

Payload = tuple[str, tuple[str, ...], bytes, dict[str, Any]]

_PING = {"type": "ping", "time": 1.0}
_TYPE = b"\xa4type\xa4ping"


def readable() -> Iterator[Payload]:
    """Yield name, statements, payload and decoded fields."""
    yield from _longer_forms()
    yield from _numbers()
    yield from _ignored()


def _longer_forms() -> Iterator[Payload]:
    whole = b"\x82" + _TYPE + b"\xa4time\x01"
    forms = {
        "a map of 16 bits": b"\xde\x00\x02" + whole[1:],
        "a map of 32 bits": b"\xdf\x00\x00\x00\x02" + whole[1:],
        "keys of 8 bits": b"\x82\xd9\x04type\xa4ping\xd9\x04time\x01",
        "texts of 16 bits": b"\x82\xa4type\xda\x00\x04ping\xa4time\x01",
        "texts of 32 bits": b"\x82\xdb\x00\x00\x00\x04type\xa4ping\xa4time\x01",
        "the type last": b"\x82\xa4time\x01" + _TYPE,
    }
    for name, payload in forms.items():
        yield name, ("PAY-12",), payload, _PING
    at = msgpack.packb({"type": "command", **AT})
    command = {"type": "command", **AT, "dq": [0.0]}
    head = b"\x86" + at[1:] + b"\xa2dq"
    yield "an array of 16 bits", ("PAY-12",), head + b"\xdc\x00\x01\x00", command
    yield "an array of 32 bits", ("PAY-12",), head + b"\xdd\x00\x00\x00\x01\x00", command


def _numbers() -> Iterator[Payload]:
    head = b"\x82" + _TYPE + b"\xa4time"
    yield "an integer as number", ("PAY-13",), head + b"\x01", _PING
    yield "an integer of 64 bits", ("PAY-12", "PAY-13"), head + b"\xcf" + bytes(7) + b"\x01", _PING
    yield "a signed integer", ("PAY-12", "PAY-13"), head + b"\xd0\x01", _PING
    yield "a negative integer", ("PAY-13",), head + b"\xff", _PING | {"time": -1.0}
    yield "a float of 32 bits", ("PAY-13",), head + b"\xca" + struct.pack(">f", 0.5), _PING | {"time": 0.5}
    huge = [1.0, -(2.0**63), 2.0**64]
    payload = msgpack.packb({"type": "command", **AT, "dq": [1, -(2**63), 2**64 - 1]})
    yield "huge integers as increments", ("PAY-13",), payload, {"type": "command", **AT, "dq": huge}
    seq = b"\x86" + msgpack.packb({"type": "command", **AT | {"seq": 0}, "dq": []})[1:].replace(
        b"\xa3seq\x00", b"\xa3seq\xd3" + bytes(7) + b"\x2a"
    )
    yield "a signed count", ("PAY-12",), seq, {"type": "command", **AT, "dq": []}


def _ignored() -> Iterator[Payload]:
    extra: dict[str, Any] = {
        "a key": 1,
        "keys of other messages": {"a": None},
        "a map of 128 keys": {f"k{i}": i for i in range(128)},
        "an array of 256 items": [0] * 256,
        "a text of 4096 bytes": "x" * 4096,
        "binary data": b"\x00" * 300,
        "NaN": float("nan"),
    }
    for name, value in extra.items():
        yield f"to be ignored: {name}", ("EVO-1",), msgpack.packb(_PING | {"wind": value}), _PING
    deep = b"\x83" + msgpack.packb(_PING)[1:] + b"\xa4wind" + b"\x91" * 7 + b"\x01"
    yield "to be ignored: nested 8 deep", ("EVO-1", "PAY-5"), deep, _PING
    payload = msgpack.packb(_PING | {f"k{i}": i for i in range(126)})
    yield "to be ignored: 126 further keys", ("EVO-1", "PAY-6"), payload, _PING
