"""Frames: lengths, limits, and streams that are split or end within a frame."""

import struct
from functools import partial
from typing import Any

from armgate.conformance.case import Skip, case, check
from armgate.conformance.codec import frame, pack
from armgate.conformance.connection import Connection
from armgate.conformance.context import CaseContext

BEFORE, AFTER = 4 * 1024, 64 * 1024


def length(count: int) -> bytes:
    """Return the length field of a frame."""
    return struct.pack(">I", count)


def padded(size: int, **fields: Any) -> bytes:
    """Return a message whose payload has this size; an unknown key pads it."""
    bare = len(pack({**fields, "pad": b""})) - 4
    data = b"\x00" * (size - bare - (1 if size - bare > 255 + 1 else 0))
    payload = pack({**fields, "pad": data})[4:]
    assert len(payload) == size, (len(payload), size)
    return frame(payload)


async def _check_serving(ctx: CaseContext) -> None:
    other = await ctx.client(name="other")
    await other.sync()


# --- split streams --------------------------------------------------------------------------------


@case("FRM-1/one", "Send hello in one frame", "One frame with a welcome")
async def hello_in_one_frame_is_welcomed(ctx: CaseContext) -> None:
    client = await ctx.client()
    check(client.welcome["type"] == "welcome", "no welcome")
    await client.sync()


@case("FRM-2/split", "Send hello in two packets, 12 times: split after byte 1, 2, … 12", "A welcome")
async def hello_split_at_any_byte_is_welcomed(ctx: CaseContext) -> None:
    for cut in range(1, 13):
        client = await ctx.connect()
        hello = ctx.target.hello(ctx.name(f"cut-{cut}"), "observer")
        client.register(hello)
        data = pack(hello)
        client.send_in_pieces((data[:cut], data[cut:]), f"hello, cut after {cut} bytes")
        await client.expect("welcome")
        client.close()


@case("FRM-2/bytewise-hello", "Send hello byte by byte", "A welcome")
async def hello_sent_byte_by_byte_is_welcomed(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("bytes"), "observer")
    client.register(hello)
    data = pack(hello)
    client.send_in_pieces((data[i : i + 1] for i in range(len(data))), "a byte of hello")
    await client.expect("welcome")


@case("FRM-2/bytewise-command", "Send a command byte by byte", "One verdict, and the robot moves accordingly")
async def command_sent_byte_by_byte_is_executed(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    tick = (await holder.next_state())["tick"]
    command = holder.make_command(tick)
    data = pack(command)
    holder.connection.register(command)
    holder.connection.send_in_pieces((data[i : i + 1] for i in range(len(data))), "a byte of a command")
    await holder.connection.expect("verdict", seq=command["seq"])


@case("FRM-2/merged", "Send 32 pings in one write", "32 pongs in their order")
async def pings_in_one_write_are_answered_in_order(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send(*({"type": "ping", "id": 100 + i, "time": float(i)} for i in range(32)))
    for i in range(32):
        await client.expect("pong", re=100 + i, time=float(i))


@case("FRM-2/straddling", "Send three pings, cut in the middle of the second", "Three pongs in their order")
async def pings_split_within_a_frame_are_answered_in_order(ctx: CaseContext) -> None:
    client = await ctx.client()
    data = b"".join(pack({"type": "ping", "time": float(i)}) for i in range(3))
    half = len(data) // 2
    client.send_bytes(data[:half], "a ping and a half")
    await client.expect("pong", time=0.0)
    client.send_bytes(data[half:], "the other half and a ping")
    await client.expect("pong", time=1.0)
    await client.expect("pong", time=2.0)


# --- limits -----------------------------------------------------------------------------------------------


async def _fatal_length(ctx: CaseContext, client: Connection, count: int, code: str) -> None:
    client.send_bytes(length(count), f"a frame's length, {count}, and nothing more")
    await client.expect_fatal(code)
    await _check_serving(ctx)


async def frame_too_large_before_hello_is_fatal(ctx: CaseContext, count: int) -> None:
    await _fatal_length(ctx, await ctx.connect(), count, "frame_too_large")


for _slug, _count in (("over", BEFORE + 1), ("huge", 2**32 - 1)):
    case(
        f"FRM-5/{_slug}",
        f"Before hello, send the length {_count} and nothing more",
        "A fatal error frame_too_large at once; the server closes; other clients are still served",
        also=("FRM-7", "CON-6", "CON-9"),
    )(partial(frame_too_large_before_hello_is_fatal, count=_count))


async def frame_too_large_after_welcome_is_fatal(ctx: CaseContext, count: int) -> None:
    await _fatal_length(ctx, await ctx.client(), count, "frame_too_large")


for _slug, _count in (("over", AFTER + 1), ("huge", 2**32 - 1), ("half", 2**31)):
    case(
        f"FRM-6/{_slug}",
        f"After the welcome, send the length {_count} and nothing more",
        "A fatal error frame_too_large at once; the server closes; other clients are still served",
        also=("FRM-7", "CON-6", "CON-9"),
    )(partial(frame_too_large_after_welcome_is_fatal, count=_count))


@case("FRM-5/largest", f"Send hello in {BEFORE} bytes, with an unknown key", "A welcome")
async def largest_hello_is_welcomed(ctx: CaseContext) -> None:
    client = await ctx.connect()
    hello = ctx.target.hello(ctx.name("largest"), "observer")
    client.register(hello)
    client.send_bytes(padded(BEFORE, **hello), "the largest hello")
    await client.expect("welcome")


@case("FRM-6/largest", f"Send a ping of {AFTER} bytes, with an unknown key", "A pong")
async def largest_ping_is_answered(ctx: CaseContext) -> None:
    client = await ctx.client()
    client.send_bytes(padded(AFTER, type="ping", time=1.0), "the largest ping")
    await client.expect("pong", time=1.0)


@case("FRM-4/outbound", "Request the description and every URDF as a whole", "No frame is longer than 1 MiB")
async def frames_to_clients_are_within_the_limit(ctx: CaseContext) -> None:
    client = await ctx.client("observer")
    description = await client.call("describe", "description")
    for robot in description["robots"]:
        await client.call("asset", "chunk", hash=robot["urdf"]["hash"])


@case("FRM-8/before-welcome", "Before hello, send the length 0", "A fatal error empty_frame")
async def empty_frame_before_welcome_is_fatal(ctx: CaseContext) -> None:
    await _fatal_length(ctx, await ctx.connect(), 0, "empty_frame")


@case("FRM-8/after-welcome", "After the welcome, send the length 0", "A fatal error empty_frame")
async def empty_frame_after_welcome_is_fatal(ctx: CaseContext) -> None:
    await _fatal_length(ctx, await ctx.client(), 0, "empty_frame")


@case(
    "FRM-5/http",
    "Send an HTTP request",
    "A fatal error frame_too_large: its first 4 bytes are a length beyond the limit",
)
async def http_request_is_refused_as_too_large(ctx: CaseContext) -> None:
    client = await ctx.connect()
    client.send_bytes(b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n", "HTTP")
    await client.expect_fatal("frame_too_large")


@case(
    "FRM-7/while-held",
    "Hold the robot, move it, then send a length beyond the limit",
    "A fatal error frame_too_large; the robot is free and comes to rest",
    also=("LOS-1", "LOS-2", "LEA-16", "LEA-21"),
)
async def frame_too_large_of_a_holder_frees_its_robot(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    await holder.move()
    holder.connection.send_bytes(length(AFTER + 1), "a length beyond the limit")
    await holder.connection.expect_fatal("frame_too_large")
    await ctx.wait_free()


# --- streams that end -------------------------------------------------------------------------------------


@case(
    "FRM-9/truncated",
    "Close the sending side inside a frame, and continue to read",
    "A fatal error truncated, then the end of the stream",
)
async def stream_that_ends_within_a_frame_is_truncated(ctx: CaseContext) -> None:
    client = await ctx.client()
    if not client.can_half_close():
        raise Skip("TLS has no half-closed connections")
    client.send_bytes(pack({"type": "ping", "time": 1.0})[:-3], "a ping without its last 3 bytes")
    client.half_close()
    found = await client.receive_until_closed()
    pongs = [m for m in found if m["type"] == "pong"]
    check(not pongs, "a truncated message was answered")
    errors = [m for m in found if m["type"] == "error"]
    check(all(m["code"] == "truncated" for m in errors), f"another error than truncated: {errors}")


@case(
    "LOS-1/reset-mid-frame",
    "Hold the robot, send half of a command, then reset the connection",
    "The robot is free within the time to live of a lease; the incomplete command has no effect; other clients are still served",
    also=("FRM-9", "CON-9"),
)
async def reset_within_a_frame_frees_the_robot(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    tick = (await holder.next_state())["tick"]
    data = pack(holder.make_command(tick))
    holder.connection.send_bytes(data[: len(data) // 2], "half of a command")
    holder.connection.reset()
    await ctx.wait_free(within=ctx.server.ttl + ctx.target.timeout)
    await _check_serving(ctx)


@case(
    "CON-10/half-closed",
    "Hold and move the robot, then close the sending side only",
    "The robot is free and comes to rest; the server closes its side",
    also=("LOS-1", "LOS-2"),
)
async def half_closed_connection_of_a_holder_frees_its_robot(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    if not holder.connection.can_half_close():
        raise Skip("TLS has no half-closed connections")
    await holder.move()
    holder.connection.half_close()
    await ctx.wait_free()
    await holder.connection.receive_until_closed()


@case(
    "LEA-13/stuck-in-a-frame",
    "Hold the robot, send 3 bytes of a frame, then nothing more",
    "The lease expires as it does for a silent holder",
)
async def lease_expires_while_a_frame_is_incomplete(ctx: CaseContext) -> None:
    holder = await ctx.holder()
    holder.connection.send_bytes(b"\x00\x00\x01", "3 bytes of a frame")
    await holder.connection.receive(
        lambda m: m["type"] == "lease" and m["state"] == "lost",
        "lease lost",
        within=ctx.server.ttl + ctx.target.timeout,
    )
    await ctx.wait_free()
