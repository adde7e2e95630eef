"""Frames: lengths, limits, and every way in which a stream may be cut."""

import struct
from typing import Any

from armgate.conformance.case import case
from armgate.conformance.packing import frame, pack
from armgate.conformance.trial import Trial
from armgate.conformance.verdicts import Skip, check
from armgate.conformance.wire import Wire

BEFORE, AFTER = 4 * 1024, 64 * 1024


def length(count: int) -> bytes:
    """A frame's length alone."""
    return struct.pack(">I", count)


def padded(size: int, **fields: Any) -> bytes:
    """A message of so many bytes of payload; what is too few is an unknown key's."""
    bare = len(pack({**fields, "pad": b""})) - 4
    data = b"\x00" * (size - bare - (1 if size - bare > 255 + 1 else 0))
    payload = pack({**fields, "pad": data})[4:]
    assert len(payload) == size, (len(payload), size)
    return frame(payload)


async def _still_there(trial: Trial) -> None:
    other = await trial.client(name="other")
    await other.in_step()


# --- how the stream is cut --------------------------------------------------------------------------------


@case("FRM-1/one", "Say hello in one frame", "One frame with a welcome")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    check(wire.welcome["type"] == "welcome", "no welcome")
    await wire.in_step()


@case(
    "FRM-2/split", "Say hello in two packets, cut in turn after every one of its first 12 bytes", "A welcome"
)
async def _(trial: Trial) -> None:
    for cut in range(1, 13):
        wire = await trial.open()
        hello = trial.target.hello(trial.name(f"cut-{cut}"), "observer")
        wire.note(hello)
        data = pack(hello)
        wire.say_in_pieces((data[:cut], data[cut:]), f"hello, cut after {cut} bytes")
        await wire.expect("welcome")
        wire.close()


@case("FRM-2/bytewise-hello", "Say hello byte by byte", "A welcome")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    hello = trial.target.hello(trial.name("bytes"), "observer")
    wire.note(hello)
    data = pack(hello)
    wire.say_in_pieces((data[i : i + 1] for i in range(len(data))), "a byte of hello")
    await wire.expect("welcome")


@case("FRM-2/bytewise-command", "Send a command byte by byte", "One verdict, and the robot moves as it says")
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    tick = (await holder.fresh())["tick"]
    command = holder.command(tick)
    data = pack(command)
    holder.wire.note(command)
    holder.wire.say_in_pieces((data[i : i + 1] for i in range(len(data))), "a byte of a command")
    await holder.wire.expect("verdict", seq=command["seq"])


@case("FRM-2/merged", "Send 32 pings in one write", "32 pongs in their order")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.say(*({"type": "ping", "id": 100 + i, "time": float(i)} for i in range(32)))
    for i in range(32):
        await wire.expect("pong", re=100 + i, time=float(i))


@case("FRM-2/straddling", "Send three pings, cut in the middle of the second", "Three pongs in their order")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    data = b"".join(pack({"type": "ping", "time": float(i)}) for i in range(3))
    half = len(data) // 2
    wire.write(data[:half], "a ping and a half")
    await wire.expect("pong", time=0.0)
    wire.write(data[half:], "the other half and a ping")
    await wire.expect("pong", time=1.0)
    await wire.expect("pong", time=2.0)


# --- limits -----------------------------------------------------------------------------------------------


async def _fatal_length(trial: Trial, wire: Wire, count: int, code: str) -> None:
    wire.write(length(count), f"a frame's length, {count}, and nothing more")
    await wire.fails(code)
    await _still_there(trial)


for _slug, _count in (("over", BEFORE + 1), ("huge", 2**32 - 1)):

    @case(
        f"FRM-5/{_slug}",
        f"Before hello, send the length {_count} and nothing more",
        "A fatal frame_too_large at once; the server closes; others are served on",
        also=("FRM-7", "CON-6", "CON-9"),
    )
    async def _(trial: Trial, count: int = _count) -> None:
        await _fatal_length(trial, await trial.open(), count, "frame_too_large")


for _slug, _count in (("over", AFTER + 1), ("huge", 2**32 - 1), ("half", 2**31)):

    @case(
        f"FRM-6/{_slug}",
        f"After the welcome, send the length {_count} and nothing more",
        "A fatal frame_too_large at once; the server closes; others are served on",
        also=("FRM-7", "CON-6", "CON-9"),
    )
    async def _(trial: Trial, count: int = _count) -> None:
        await _fatal_length(trial, await trial.client(), count, "frame_too_large")


@case("FRM-5/largest", f"Say hello in {BEFORE} bytes, with an unknown key", "A welcome")
async def _(trial: Trial) -> None:
    wire = await trial.open()
    hello = trial.target.hello(trial.name("largest"), "observer")
    wire.note(hello)
    wire.write(padded(BEFORE, **hello), "the largest hello")
    await wire.expect("welcome")


@case("FRM-6/largest", f"Send a ping of {AFTER} bytes, with an unknown key", "A pong")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    wire.write(padded(AFTER, type="ping", time=1.0), "the largest ping")
    await wire.expect("pong", time=1.0)


@case("FRM-4/outbound", "Ask for the description and for the whole of every URDF", "No frame is beyond 1 MiB")
async def _(trial: Trial) -> None:
    wire = await trial.client("observer")
    description = await wire.answered("describe", "description")
    for robot in description["robots"]:
        await wire.answered("asset", "chunk", hash=robot["urdf"]["hash"])


@case("FRM-8/before-welcome", "Before hello, send the length 0", "A fatal empty_frame")
async def _(trial: Trial) -> None:
    await _fatal_length(trial, await trial.open(), 0, "empty_frame")


@case("FRM-8/after-welcome", "After the welcome, send the length 0", "A fatal empty_frame")
async def _(trial: Trial) -> None:
    await _fatal_length(trial, await trial.client(), 0, "empty_frame")


@case(
    "FRM-5/http",
    "Speak HTTP to it",
    "A fatal frame_too_large: its first 4 bytes are a length beyond the limit",
)
async def _(trial: Trial) -> None:
    wire = await trial.open()
    wire.write(b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n", "HTTP")
    await wire.fails("frame_too_large")


@case(
    "FRM-7/while-held",
    "Hold the robot, move it, then send a length beyond the limit",
    "A fatal frame_too_large; the robot is free and comes to rest",
    also=("LOS-1", "LOS-2", "LEA-16", "LEA-21"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    await holder.moved()
    holder.wire.write(length(AFTER + 1), "a length beyond the limit")
    await holder.wire.fails("frame_too_large")
    await trial.freed()


# --- streams that end -------------------------------------------------------------------------------------


@case("FRM-9/truncated", "End the stream inside a frame, and read on", "A fatal truncated, then the end")
async def _(trial: Trial) -> None:
    wire = await trial.client()
    if not wire.can_half_close():
        raise Skip("TLS has no half-closed connections")
    wire.write(pack({"type": "ping", "time": 1.0})[:-3], "a ping without its last 3 bytes")
    wire.half_close()
    found = await wire.ends()
    pongs = [m for m in found if m["type"] == "pong"]
    check(not pongs, "a message that was cut off was answered")
    errors = [m for m in found if m["type"] == "error"]
    check(all(m["code"] == "truncated" for m in errors), f"another error than truncated: {errors}")


@case(
    "LOS-1/reset-mid-frame",
    "Hold the robot, send half of a command, then reset the connection",
    "The robot is free within the time to live of a lease; the half command does nothing; others are served on",
    also=("FRM-9", "CON-9"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    tick = (await holder.fresh())["tick"]
    data = pack(holder.command(tick))
    holder.wire.write(data[: len(data) // 2], "half of a command")
    holder.wire.reset()
    await trial.freed(within=trial.facts.ttl + trial.target.patience)
    await _still_there(trial)


@case(
    "CON-10/half-closed",
    "Hold and move the robot, then close the sending side only",
    "The robot is free and comes to rest; the server closes its side",
    also=("LOS-1", "LOS-2"),
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    if not holder.wire.can_half_close():
        raise Skip("TLS has no half-closed connections")
    await holder.moved()
    holder.wire.half_close()
    await trial.freed()
    await holder.wire.ends()


@case(
    "LEA-13/stuck-in-a-frame",
    "Hold the robot, send 3 bytes of a frame, then nothing more",
    "The lease expires as it does for a silent holder",
)
async def _(trial: Trial) -> None:
    holder = await trial.holder()
    holder.wire.write(b"\x00\x00\x01", "3 bytes of a frame")
    await holder.wire.hear(
        lambda m: m["type"] == "lease" and m["state"] == "lost",
        "lease lost",
        within=trial.facts.ttl + trial.target.patience,
    )
    await trial.freed()
