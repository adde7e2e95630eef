"""Payloads that a receiver must refuse, written by hand, with the error that is due."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgpack

from tools.spec.examples import COMMAND, HASH, messages

HELLO = {"type": "hello", "versions": [1], "name": "wave"}


@dataclass(frozen=True)
class Fault:
    """Invalid payload and the error that is due.

    Attributes:
        name: Description of the fault.
        statements: Statements that require the error.
        payload: The bytes.
        code: Code of the error.
        fatal: True if the error ends the connection.
        more: Further fields of the error: ``about``, ``re``, ``seq``.
        side: Side that sends the payload.
        state: State of the connection: ``ready`` or ``await_hello``.
    """

    name: str
    statements: tuple[str, ...]
    payload: bytes
    code: str
    fatal: bool
    more: dict[str, Any]
    side: str = "client"
    state: str = "ready"


def faults() -> Iterator[Fault]:
    """Yield all faults."""
    yield from _malformed()
    yield from _unknown()
    yield from _wrong_forms()
    yield from _missing()
    yield from _before_the_welcome()


def _nested(levels: int) -> bytes:
    return b"\x81\xa1a" + b"\x91" * (levels - 1) + b"\x01"


def _pack(value: object) -> bytes:
    packed: bytes = msgpack.packb(value)
    return packed


_PING = b"\x82\xa4type\xa4ping\xa4time"
_MALFORMED: list[tuple[str, str, bytes]] = [
    ("PAY-2", "a byte that msgpack reserves", b"\xc1"),
    ("PAY-2", "half a map", b"\x82\xa1a\x01"),
    ("PAY-2", "a map that ends inside a number", _PING + b"\xcb\x00\x00"),
    ("PAY-2", "bytes after the map", _PING + b"\x01\x01"),
    ("PAY-2", "two maps", _PING + b"\x01" + _PING + b"\x01"),
    ("PAY-2", "an array", _pack(["ping", 1])),
    ("PAY-2", "a number", b"\x01"),
    ("PAY-2", "nil", b"\xc0"),
    ("PAY-2", "a text", _pack("ping")),
    ("PAY-2", "JSON", b'{"type": "ping", "time": 1}'),
    ("PAY-2", "a text with a declared length of 4 GiB", b"\x81\xa1a\xdb\xff\xff\xff\xff"),
    ("PAY-2", "binary data with a declared length of 4 GiB", b"\x81\xa1a\xc6\xff\xff\xff\xff"),
    ("PAY-3", "a number as a key", b"\x81\x01\x02"),
    ("PAY-3", "nil as a key", b"\x81\xc0\x02"),
    ("PAY-3", "binary data as a key", b"\x81\xc4\x01a\x02"),
    ("PAY-3", "an array as a key", b"\x81\x91\x01\x02"),
    ("PAY-3", "a number as a key of an inner map", b"\x81\xa1m\x81\x01\x02"),
    ("PAY-4", "a key twice", b"\x82\xa1a\x01\xa1a\x02"),
    ("PAY-4", "the type twice", b"\x83\xa4type\xa4ping\xa4time\x01\xa4type\xa3bye"),
    ("PAY-4", "a key twice in an inner map", b"\x81\xa1m\x82\xa1a\x01\xa1a\x01"),
    ("PAY-4", "a key twice, in two encodings", b"\x82\xa1a\x01\xd9\x01a\x02"),
    ("PAY-5", "nested 9 deep", _nested(9)),
    ("PAY-5", "nested 5000 deep", _nested(5000)),
    ("PAY-6", "a map of 129 keys", _pack({f"k{i}": 0 for i in range(129)})),
    ("PAY-6", "a map with a declared length of 2^32 - 1 keys", b"\xdf\xff\xff\xff\xff"),
    ("PAY-7", "an array of 257 items", _pack({"type": "ping", "time": 0.0, "a": [0] * 257})),
    ("PAY-7", "an array with a declared length of 2^32 - 1 items", b"\x81\xa1a\xdd\xff\xff\xff\xff"),
    ("PAY-8", "a text of 4097 bytes", _pack({"type": "ping", "time": 0.0, "a": "x" * 4097})),
    ("PAY-9", "a text that is not UTF-8", b"\x81\xa1a\xa1\xff"),
    ("PAY-9", "a text with a surrogate", b"\x81\xa1a\xa3\xed\xa0\x80"),
    ("PAY-9", "a key that is not UTF-8", b"\x81\xa1\xff\x01"),
    ("PAY-10", "an extension of 1 byte", b"\x81\xa1a\xd4\x05\x00"),
    ("PAY-10", "an extension of 16 bytes", b"\x81\xa1a\xd8\x05" + bytes(16)),
    ("PAY-10", "an extension of no bytes", b"\x81\xa1a\xc7\x00\x05"),
    ("PAY-10", "an extension with a declared length of 4 GiB", b"\x81\xa1a\xc9\xff\xff\xff\xff\x05"),
    ("PAY-10", "a time stamp of 32 bits", b"\x81\xa1a\xd6\xff\x00\x00\x00\x01"),
    ("PAY-10", "a time stamp of 64 bits", b"\x81\xa1a\xd7\xff" + bytes(8)),
    ("PAY-10", "a time stamp of 96 bits", b"\x81\xa1a\xc7\x0c\xff" + bytes(12)),
]


def _malformed() -> Iterator[Fault]:
    for statement, name, payload in _MALFORMED:
        yield Fault(name, (statement,), payload, "malformed", True, {})


def _unknown() -> Iterator[Fault]:
    for kind, about in (("tea", "tea"), ("Ping", "Ping"), ("state", "state"), ("error", "error"), ("", None)):
        payload = _pack({"type": kind, "id": 9})
        more = {"about": about, "re": 9} if about else {"re": 9}
        yield Fault(f"a message of type {kind!r}", ("ERR-3",), payload, "unknown_type", False, more)
    wrong: list[object] = [None, 7, True, b"ping", ["ping"], {}]
    for one in wrong:
        payload = _pack({"type": one, "time": 0.0})
        yield Fault(f"the type {one!r}", ("ERR-4",), payload, "invalid_message", False, {})
    yield Fault("no type", ("ERR-4",), _pack({"time": 0.0}), "invalid_message", False, {})
    second = _pack(HELLO | {"id": 3})
    more = {"about": "hello", "re": 3}
    yield Fault("a second hello", ("HEL-6", "CON-2"), second, "unexpected", True, more)


_WRONG: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("PAY-14", COMMAND, {"dq": ["0.1"]}),
    ("PAY-14", COMMAND, {"dq": [True]}),
    ("PAY-14", COMMAND, {"dq": [None]}),
    ("PAY-14", COMMAND, {"dq": [[0.1]]}),
    ("ERR-4", COMMAND, {"dq": 0.1}),
    ("ERR-4", COMMAND, {"dq": b"\x00"}),
    ("ERR-4", COMMAND, {"dq": [0.0] * 65}),
    ("PAY-15", COMMAND, {"fence": -1}),
    ("PAY-15", COMMAND, {"fence": 2**63}),
    ("PAY-15", COMMAND, {"tick": 1.0}),
    ("PAY-15", COMMAND, {"tick": 0.5}),
    ("PAY-15", COMMAND, {"tick": True}),
    ("PAY-15", COMMAND, {"tick": "1"}),
    ("PAY-15", COMMAND, {"seq": -1}),
    ("PAY-15", COMMAND, {"seq": 2**64 - 1}),
    ("PAY-15", COMMAND, {"seq": True}),
    ("PAY-16", COMMAND, {"deadline": math.nan}),
    ("PAY-18", COMMAND, {"robot": "F R"}),
    ("PAY-18", COMMAND, {"robot": ""}),
    ("PAY-18", COMMAND, {"robot": "x" * 65}),
    ("PAY-18", COMMAND, {"robot": "Ä"}),
    ("PAY-18", COMMAND, {"robot": "FR\n"}),
    ("PAY-18", COMMAND, {"robot": b"FR"}),
    ("PAY-16", {"type": "ping", "time": 0.0}, {"time": math.nan}),
    ("PAY-16", {"type": "ping", "time": 0.0}, {"time": math.inf}),
    ("PAY-16", {"type": "ping", "time": 0.0}, {"time": -math.inf}),
    ("PAY-14", {"type": "ping", "time": 0.0}, {"time": "0"}),
    ("PAY-14", {"type": "ping", "time": 0.0}, {"time": None}),
    ("PAY-15", {"type": "ping", "time": 0.0}, {"id": 2**31}),
    ("PAY-15", {"type": "ping", "time": 0.0}, {"id": -1}),
    ("PAY-15", {"type": "ping", "time": 0.0}, {"id": "1"}),
    ("SIG-5", {"type": "signal", "name": "zoom", "value": [0.0]}, {"value": []}),
    ("SIG-5", {"type": "signal", "name": "zoom", "value": [0.0]}, {"value": [0.0] * 17}),
    ("PAY-16", {"type": "signal", "name": "zoom", "value": [0.0]}, {"value": [math.nan]}),
    ("ERR-4", {"type": "signal", "name": "zoom", "value": [0.0]}, {"value": 0.0}),
    ("ERR-4", {"type": "acquire", "robot": "FR"}, {"speed": 0.0}),
    ("ERR-4", {"type": "acquire", "robot": "FR"}, {"speed": 1.5}),
    ("ERR-4", {"type": "acquire", "robot": "FR"}, {"speed": -0.5}),
    ("ERR-4", {"type": "acquire", "robot": "FR"}, {"takeover": 1}),
    ("ERR-4", {"type": "subscribe"}, {"every": -1}),
    ("ERR-4", {"type": "subscribe"}, {"every": 10001}),
    ("ERR-4", {"type": "subscribe"}, {"robots": "FR"}),
    ("ERR-4", {"type": "subscribe"}, {"robots": ["FR"] * 33}),
    ("ERR-4", {"type": "subscribe"}, {"fields": [1]}),
    ("ERR-4", {"type": "asset", "hash": HASH}, {"hash": HASH.upper()}),
    ("ERR-4", {"type": "asset", "hash": HASH}, {"hash": HASH[1:]}),
    ("ERR-4", {"type": "asset", "hash": HASH}, {"length": 0}),
    ("ERR-4", {"type": "asset", "hash": HASH}, {"length": 262145}),
    ("ERR-4", {"type": "stop"}, {"reason": "x" * 513}),
    ("ERR-4", {"type": "stop"}, {"reason": None}),
]


def _wrong_forms() -> Iterator[Fault]:
    for statement, good, change in _WRONG:
        (field, value), *_ = change.items()
        yield _invalid(f"{good['type']} with {field} {_short(value)}", (statement, "ERR-4"), good | change)


def _missing() -> Iterator[Fault]:
    for side, name, value in messages():
        if not name.endswith(": minimal") or value["type"] == "hello" or value["type"] == "welcome":
            continue
        for field in value:
            if field != "type":
                rest = {key: item for key, item in value.items() if key != field}
                yield _invalid(f"{value['type']} without {field}", ("ERR-4", "MSG-1"), rest, side)


def _invalid(name: str, statements: tuple[str, ...], value: dict[str, Any], side: str = "client") -> Fault:
    more: dict[str, Any] = {"about": value["type"]}
    if value["type"] == "command" and type(seq := value.get("seq")) is int and 0 <= seq < 2**63:
        more["seq"] = seq
    return Fault(name, tuple(dict.fromkeys(statements)), _pack(value), "invalid_message", False, more, side)


def _before_the_welcome() -> Iterator[Fault]:
    first: list[tuple[str, str, dict[str, Any], str]] = [
        ("HEL-4", "describe before hello", {"type": "describe"}, "unexpected"),
        ("HEL-4", "a command before hello", COMMAND, "unexpected"),
        ("HEL-5", "an unknown type before hello", {"type": "tea"}, "unknown_type"),
        ("HEL-5", "hello without versions", {"type": "hello", "name": "wave"}, "invalid_message"),
        ("HEL-5", "hello with no versions", HELLO | {"versions": []}, "invalid_message"),
        ("HEL-5", "hello with version 0", HELLO | {"versions": [0]}, "invalid_message"),
        ("HEL-5", "hello with version 65537", HELLO | {"versions": [65537]}, "invalid_message"),
        ("HEL-5", "hello with 17 versions", HELLO | {"versions": list(range(1, 18))}, "invalid_message"),
        ("HEL-5", "hello without a name", {"type": "hello", "versions": [1]}, "invalid_message"),
        ("HEL-5", "hello with an unknown role", HELLO | {"role": "king"}, "invalid_message"),
        ("HEL-5", "hello with an empty token", HELLO | {"token": ""}, "invalid_message"),
        ("HEL-5", "hello with a token that is too long", HELLO | {"token": "x" * 257}, "invalid_message"),
        ("VER-4", "hello with unsupported versions", HELLO | {"versions": [65535, 65536]}, "version"),
    ]
    for statement, name, value, code in first:
        more = {"about": value["type"]} | ({"seq": value["seq"]} if "seq" in value else {})
        yield Fault(name, (statement,), _pack(value), code, True, more, state="await_hello")


def _short(value: Any) -> str:
    if isinstance(value, (list, str)) and len(value) > 8:
        return f"of length {len(value)}"
    return repr(value)
