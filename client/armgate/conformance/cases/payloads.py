"""Payloads: well-formed maps, their limits, and the errors for all others."""

import math
import struct
from functools import partial
from typing import Any

import msgpack

from armgate.conformance.case import case, check
from armgate.conformance.codec import frame, pack
from armgate.conformance.context import CaseContext

PING = {"type": "ping", "time": 1.0}


def nested(depth: int) -> Any:
    """Return a value nested this deep."""
    value: Any = []
    for _ in range(depth - 1):
        value = [value]
    return value


def raw_map(*pairs: tuple[bytes, bytes]) -> bytes:
    """Return a msgpack map of packed keys and values."""
    return bytes([0x80 | len(pairs)]) + b"".join(key + value for key, value in pairs)


def key(text: str) -> bytes:
    """Return a packed text."""
    packed: bytes = msgpack.packb(text)
    return packed


def with_x(value: bytes) -> bytes:
    """Return a ping with an unknown key that holds a packed value."""
    return raw_map((key("type"), key("ping")), (key("time"), msgpack.packb(1.0)), (key("x"), value))


def text_of(size: int) -> bytes:
    """Return a packed text of this many bytes."""
    return key("é" * (size // 2))


MALFORMED: dict[str, tuple[str, str, bytes]] = {
    "array": ("PAY-2", "an array", msgpack.packb(["ping", 1.0])),
    "number": ("PAY-2", "a number", msgpack.packb(7)),
    "nil": ("PAY-2", "nil", msgpack.packb(None)),
    "text": ("PAY-2", "a text", msgpack.packb("ping")),
    "trailing": ("PAY-2", "a ping and one byte more", msgpack.packb(PING) + b"\xc0"),
    "two-maps": ("PAY-2", "two pings", msgpack.packb(PING) * 2),
    "cut-off": ("PAY-2", "a map that announces more than it holds", msgpack.packb(PING)[:-2]),
    "never-used": ("PAY-2", "the byte that msgpack does not define", b"\xc1"),
    "garbage": ("PAY-2", "64 bytes of garbage", bytes((i * 73 + 41) % 256 for i in range(64))),
    "json": ("PAY-2", "JSON", b'{"type": "ping", "time": 1.0}'),
    "number-key": ("PAY-3", "a map with a number as a key", with_x(b"\xc0")[:-3] + b"\x07\xc0"),
    "binary-key": ("PAY-3", "a map with binary data as a key", raw_map((b"\xc4\x04type", key("ping")))),
    "promised-huge": ("PAY-7", "an array that announces 2**32 - 1 items", with_x(b"\xdd\xff\xff\xff\xff")),
    "too-deep": ("PAY-5", "a value nested 8 deep in the message", with_x(msgpack.packb(nested(8)))),
    "far-too-deep": ("PAY-5", "a value nested 2000 deep", with_x(b"\x91" * 2000 + b"\xc0")),
    "many-keys": ("PAY-6", "a map of 129 keys", with_x(msgpack.packb({f"k{i}": i for i in range(129)}))),
    "long-array": ("PAY-7", "an array of 257 items", with_x(msgpack.packb([0] * 257))),
    "long-text": ("PAY-8", "a text of 4098 bytes", with_x(text_of(4098))),
    "twice": ("PAY-4", "a key that occurs twice", raw_map((key("type"), key("ping")), *[(key("time"), msgpack.packb(1.0))] * 2)),
    "twice-inside": ("PAY-4", "a key that occurs twice in a nested map", with_x(raw_map((key("a"), b"\x01"), (key("a"), b"\x02")))),
    "not-utf8": ("PAY-9", "a text that is not UTF-8", with_x(b"\xa2\xff\xfe")),
    "surrogate": ("PAY-9", "a text with half of a surrogate pair", with_x(b"\xa3\xed\xa0\x80")),
    "extension": ("PAY-10", "an extension type", with_x(msgpack.packb(msgpack.ExtType(7, b"abcd")))),
    "timestamp": ("PAY-10", "a time stamp", with_x(msgpack.packb(msgpack.Timestamp(1, 0)))),
}  # fmt: skip


async def malformed_payload_is_fatal(ctx: CaseContext, payload: bytes) -> None:
    client = await ctx.client()
    client.send_bytes(
        frame(payload) + pack({"type": "stop", "reason": "behind garbage"}), "garbage, then a stop"
    )
    await client.expect_fatal("malformed")
    await ctx.observer.ticks(ctx.robot, 2)
    check(not ctx.observer.stops(), "a message after a fatal fault was processed: there is a stop")
    other = await ctx.client("observer", "other")
    await other.sync()


for _slug, (_statement, _what, _payload) in MALFORMED.items():
    case(
        f"{_statement}/{_slug}",
        f"After the welcome, send {_what}, followed by a stop",
        "A fatal error malformed and nothing more: the stop is not read; other clients are still served",
        also=("CON-6", "CON-7", "CON-9"),
    )(partial(malformed_payload_is_fatal, payload=_payload))


@case("PAY-2/before-welcome", "Before hello, send garbage in a frame", "A fatal error malformed")
async def malformed_payload_before_hello_is_fatal(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send_bytes(frame(b"\xc1\xc1\xc1"), "garbage")
    await client.expect_fatal("malformed")


WITHIN: dict[str, tuple[str, str, bytes]] = {
    "deep": ("PAY-5", "a value nested 7 deep in the message", msgpack.packb(nested(7))),
    "keys": ("PAY-6", "a map of 128 keys", msgpack.packb({f"k{i}": i for i in range(128)})),
    "array-256": ("PAY-7", "an array of 256 items", msgpack.packb([0] * 256)),
    "text-4096": ("PAY-8", "a text of 4096 bytes", text_of(4096)),
    "binary": ("PAY-12", "60000 bytes of binary data", msgpack.packb(b"\x00" * 60000)),
    "big-number": ("PAY-12", "the number 2**64 - 1", msgpack.packb(2**64 - 1)),
    "small-float": ("PAY-13", "a number of single precision", b"\xca" + struct.pack(">f", 0.5)),
    "long-forms": ("PAY-12", "a number in 9 bytes where 1 would do", b"\xd3" + struct.pack(">q", 1)),
}


async def payload_within_the_limits_is_accepted(ctx: CaseContext, payload: bytes) -> None:
    client = await ctx.client()
    client.send_bytes(frame(with_x(payload)), "a ping with an unknown key")
    await client.expect("pong", time=1.0)


for _slug, (_statement, _what, _payload) in WITHIN.items():
    case(
        f"{_statement}/{_slug}",
        f"Send a ping with an unknown key that holds {_what}",
        "A pong",
        also=("EVO-1",),
    )(partial(payload_within_the_limits_is_accepted, payload=_payload))


# --- fields -----------------------------------------------------------------------------------------------

WRONG: dict[str, tuple[str, str, dict[str, Any], str]] = {
    "text-for-number": ("PAY-14", "a text instead of a number", {"type": "ping", "time": "1.0"}, "time"),
    "bool-for-number": ("PAY-14", "a bool instead of a number", {"type": "ping", "time": True}, "time"),
    "nil-for-number": ("PAY-14", "nil instead of a number", {"type": "ping", "time": None}, "time"),
    "nan": ("PAY-16", "NaN instead of a number", {"type": "ping", "time": math.nan}, "time"),
    "infinity": ("PAY-16", "infinity instead of a number", {"type": "ping", "time": math.inf}, "time"),
    "number-for-text": ("ERR-4", "a number instead of a text", {"type": "stop", "reason": 5}, "reason"),
    "number-for-bool": ("ERR-4", "a number instead of a bool", {"type": "acquire", "robot": "R", "takeover": 1}, "takeover"),
    "real-for-count": ("PAY-15", "a fraction instead of a count", {"type": "subscribe", "every": 1.5}, "every"),
    "whole-real-for-count": ("PAY-15", "1.0 instead of a count", {"type": "subscribe", "every": 1.0}, "every"),
    "negative": ("PAY-15", "a negative count", {"type": "reset", "stop": -1}, "stop"),
    "big-count": ("PAY-15", "2**63 instead of a count", {"type": "reset", "stop": 2**63}, "stop"),
    "missing": ("ERR-4", "a ping without time", {"type": "ping"}, "time"),
    "long-reason": ("ERR-4", "a reason of 513 characters", {"type": "stop", "reason": "x" * 513}, "reason"),
    "bad-speed": ("ERR-4", "a speed of 0", {"type": "acquire", "robot": "R", "speed": 0.0}, "speed"),
    "fast": ("ERR-4", "a speed of 1.5", {"type": "acquire", "robot": "R", "speed": 1.5}, "speed"),
    "nan-speed": ("PAY-16", "a speed that is NaN", {"type": "acquire", "robot": "R", "speed": math.nan}, "speed"),
    "too-seldom": ("ERR-4", "a subscription to every 10001st tick", {"type": "subscribe", "every": 10001}, "every"),
    "bad-hash": ("ERR-4", "a hash in capital letters", {"type": "asset", "hash": "A" * 64}, "hash"),
    "no-length": ("ERR-4", "a piece of an asset of 0 bytes", {"type": "asset", "hash": "0" * 64, "length": 0}, "length"),
    "map-for-list": ("ERR-4", "a map instead of an array", {"type": "subscribe", "robots": {"a": 1}}, "robots"),
    "empty-name": ("PAY-18", "an empty name", {"type": "acquire", "robot": ""}, "robot"),
    "long-name": ("PAY-18", "a name of 65 characters", {"type": "acquire", "robot": "x" * 65}, "robot"),
    "space": ("PAY-18", "a name with a space", {"type": "acquire", "robot": "a b"}, "robot"),
    "newline": ("PAY-18", "a name followed by a newline", {"type": "acquire", "robot": "ab\n"}, "robot"),
    "umlaut": ("PAY-18", "a name with an ä", {"type": "acquire", "robot": "ä"}, "robot"),
}  # fmt: skip


async def invalid_field_is_refused_and_named(ctx: CaseContext, fields: dict[str, Any], field: str) -> None:
    client = await ctx.client()
    rest = {name: value for name, value in fields.items() if name != "type"}
    if rest.get("robot") == "R":
        rest["robot"] = ctx.robot
    error = await client.expect_refusal(fields["type"], "invalid_message", **rest)
    check(field in error["text"], f"the text does not name the field {field}: {error['text']}")
    check(error.get("about") == fields["type"], f"about is {error.get('about')}, not {fields['type']}")
    await client.sync()
    await ctx.observer.ticks(ctx.robot, 1)
    check(not ctx.observer.stops(), "a stop that was refused is in force")
    check(ctx.entry()["holder"] is None, "an acquire that was refused was granted")


for _slug, (_statement, _what, _fields, _field) in WRONG.items():
    case(
        f"{_statement}/{_slug}",
        f"Send {_what}",
        "An error invalid_message, not fatal, with the field in its text and the request's id; no effect; the next ping is answered",
        also=("ERR-2", "ERR-4", "ERR-5", "ERR-6", "ERR-7", "MSG-3"),
    )(partial(invalid_field_is_refused_and_named, fields=_fields, field=_field))


@case("PAY-13/integer-for-number", "Send an integer instead of a float", "A pong that repeats it")
async def integer_is_accepted_as_a_number(ctx: CaseContext) -> None:
    client = await ctx.client()
    pong = await client.call("ping", "pong", time=3)
    check(pong["time"] == 3, f"the pong repeats {pong['time']}")


@case(
    "EVO-1/in-requests",
    "Send hello, subscribe and ping with unknown keys",
    "All are answered as without them",
)
async def unknown_keys_of_requests_are_ignored(ctx: CaseContext) -> None:
    client = await ctx.client(hue="red", nested={"a": [1, {"b": None}]})
    await client.call("subscribe", "subscribed", every=0, colour=[1, 2])
    await client.call("ping", "pong", time=1.0, Time=2.0)


@case("EVO-1/in-command", "Send a command with unknown keys", "It has the same verdict as without them")
async def unknown_keys_of_commands_are_ignored(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    verdict = await holder.command(torque=[1.0], model={"name": "x"})
    check(verdict["outcome"] == "admitted", f"it was {verdict['outcome']}: {verdict.get('reasons')}")


@case(
    "PAY-17/defaults",
    "Send hello with versions and name only; acquire with robot only",
    "Role controller, speed 1, no takeover",
)
async def omitted_keys_have_their_defaults(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("bare"), "controller")
    del hello["role"]
    client.send(hello)
    welcome = await client.expect("welcome")
    check(welcome["role"] == "controller", f"the role is {welcome['role']}")
    lease = await client.call("acquire", "lease", robot=ctx.robot)
    check(lease.get("speed", 1.0) == 1.0, f"the lease's speed is {lease.get('speed')}")


@case(
    "ERR-3/unknown",
    "Send a message of the type teleport",
    "An error unknown_type, not fatal, about it; then a pong",
)
async def unknown_type_is_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    error = await client.expect_refusal("teleport", "unknown_type", where=[0, 0])
    check(error.get("about") == "teleport", f"about is {error.get('about')}")
    await client.sync()


@case(
    "ERR-3/wrong-direction",
    "Send a state, a message of the server",
    "An error unknown_type, not fatal; then a pong",
)
async def message_of_the_server_is_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    await client.expect_refusal("state", "unknown_type", robot=ctx.robot, tick=1, time=0.0, entries=[])
    await client.sync()


@case("ERR-4/no-type", "Send a map without type", "An error invalid_message, not fatal; then a pong")
async def map_without_type_is_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send({"time": 1.0})
    await client.expect("error", code="invalid_message", fatal=False)
    await client.sync()


@case(
    "ERR-4/type-number",
    "Send a map whose type is a number",
    "An error invalid_message, not fatal; then a pong",
)
async def map_with_a_number_as_type_is_refused(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send({"type": 5})
    await client.expect("error", code="invalid_message", fatal=False)
    await client.sync()


_HELLOS: dict[str, dict[str, Any]] = {
    "no-name": {"name": None},
    "bad-name": {"name": "a b"},
    "no-versions": {"versions": []},
    "version-0": {"versions": [0]},
    "many-versions": {"versions": list(range(1, 18))},
    "text-version": {"versions": ["1"]},
    "bad-role": {"role": "king"},
    "long-token": {"token": "x" * 257},
}


async def invalid_hello_is_fatal(ctx: CaseContext, more: dict[str, Any]) -> None:
    client = await ctx.connect()
    client.send({**ctx.target.hello(ctx.name("odd"), "controller"), **more})
    await client.expect_fatal("invalid_message")


for _slug, _more in _HELLOS.items():
    case(
        f"HEL-5/hello-{_slug}",
        f"Send hello with {_more}".replace("x" * 257, "x…"),
        "A fatal error invalid_message: before the welcome every refusal is fatal",
    )(partial(invalid_hello_is_fatal, more=_more))


@case("HEL-5/unknown-type", "Before hello, send a message of unknown type", "A fatal error")
async def unknown_type_before_hello_is_fatal(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send({"type": "teleport"})
    await client.expect_fatal("unknown_type")


@case(
    "HEL-7/all-characters",
    "Send hello with a name of 64 characters of every kind allowed",
    "A welcome with that name",
)
async def name_may_hold_all_allowed_characters(ctx: CaseContext) -> None:
    client = await ctx.connect()
    name = (ctx.name("A-Z/a-z:0.9_") + "x" * 64)[:64]
    client.send(ctx.target.hello(name, "observer"))
    await client.expect("welcome", name=name)


@case(
    "ERR-8/token",
    "Send hello with a secret token that is too long",
    "The error's text does not repeat the token",
)
async def error_does_not_repeat_a_token(ctx: CaseContext) -> None:
    client = await ctx.connect()
    secret = "hunter2-" * 40
    client.send({**ctx.target.hello(ctx.name("secret"), "controller"), "token": secret})
    error = await client.expect_fatal("invalid_message")
    check("hunter2" not in error["text"], "the error repeats the token")
