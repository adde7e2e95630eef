"""Clients that violate the protocol or overload the daemon: ``python abusers.py PORT [KIND]``.

The process prints "ready" when all clients run, and runs until it is killed. Kinds:

- ``mixed`` (the default): one client sends garbage and reconnects, one sends many messages of an unknown
  type, one never reads, 200 never send a hello, and one connects and aborts 1000 times;
- ``pings``, ``subscribes``, ``describes``, ``large``, ``crooked``: one observer on many connections, which
  send such messages as fast as the daemon accepts them; ``crooked``: stops with a wrong field and padding;
- ``fields``: one observer on many connections, each of which receives another set of fields at every tick.
"""

import asyncio
import contextlib
import os
import random
import sys

import msgpack

HALF_OPEN = 200
FLOOD = 1000
PAUSE = 0.002


def framed(**fields):
    payload = msgpack.packb(fields)
    return len(payload).to_bytes(4, "big") + payload


HELLO = framed(type="hello", versions=[1], name="bad", role="observer")
SUBSCRIBE = framed(type="subscribe", every=1)


async def open_(port):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    return reader, writer


async def garbage(port):
    """Send random bytes, before or after a hello, and reconnect."""
    chance = random.Random(1)
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await open_(port)
            writer.write(chance.choice((b"", HELLO)) + chance.randbytes(chance.randrange(1, 20_000)))
            await reader.read()
            writer.close()
        await asyncio.sleep(PAUSE)


async def unreadable(port):
    """Send as many small messages of an unknown type as the daemon accepts."""
    nonsense = framed(type="x") * 500
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await open_(port)
            writer.write(HELLO)
            while not writer.is_closing():
                writer.write(nonsense)
                await writer.drain()
                await asyncio.wait_for(reader.read(1 << 20), 1.0)
        await asyncio.sleep(PAUSE)


async def never_reading(port):
    """Subscribe to all states, request descriptions, and never read."""
    while True:
        with contextlib.suppress(OSError):
            _, writer = await open_(port)
            writer.transport.pause_reading()
            writer.write(HELLO + SUBSCRIBE)
            while not writer.is_closing():
                writer.write(framed(type="describe", id=1) * 10)
                await writer.drain()
                await asyncio.sleep(PAUSE)
        await asyncio.sleep(PAUSE)


async def half_open(port):
    """Send two bytes of a frame, and reconnect when the daemon closes the connection."""
    while True:
        with contextlib.suppress(OSError, TimeoutError):
            reader, writer = await open_(port)
            writer.write(b"\x00\x00")
            await reader.read()
            writer.close()
        await asyncio.sleep(0.1)


async def flood(port):
    """Connect and abort a thousand times."""
    for _ in range(FLOOD):
        with contextlib.suppress(OSError):
            _, writer = await open_(port)
            writer.transport.abort()
        await asyncio.sleep(PAUSE)


# --- one observer on many connections ---------------------------------------------------------------------

FIELDS = ("q", "setpoint", "applied_seq", "stop_end", "nearest", "holder", "stops", "link", "verdict")


def fields_of(number):
    """Return a set of fields that differs between numbers."""
    return [name for bit, name in enumerate(FIELDS) if (number + 1) >> bit & 1]


def subscribe(number):
    return framed(type="subscribe", every=1, fields=fields_of(number), id=1)


def crowd(kind):
    """Return the bytes that each connection sends repeatedly; for ``fields`` once."""
    if kind == "subscribes":
        return [b"".join(subscribe(7 * number + k) for k in range(100)) for number in range(20)]
    if kind == "fields":
        return [subscribe(number) for number in range(60)]
    message = {
        "pings": framed(type="ping", time=1.0, id=1) * 200,
        "describes": framed(type="describe", id=1) * 100,
        "large": framed(type="x", a=[[1.0] * 250] * 28),
        "crooked": framed(type="stop", robot=5, pad=[[1] * 250] * 15) * 60,
    }[kind]
    return [message] * 60


async def one_of_crowd(port, data, again):
    """Send the data on a connection, and reconnect whenever the daemon has closed it."""
    while True:
        try:
            reader, writer = await open_(port)
            writer.write(HELLO + data)
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(read_all(reader))
                if again:
                    tasks.create_task(write_on(writer, data))
        except* OSError:
            pass
        await asyncio.sleep(0.1)


async def write_on(writer, data):
    while not writer.is_closing():
        writer.write(data)
        await writer.drain()
        await asyncio.sleep(0)


async def read_all(reader):
    while await reader.read(1 << 16):
        pass


def tasks_of(port, kind):
    if kind == "mixed":
        bad = [garbage, unreadable, never_reading, flood, *[half_open] * HALF_OPEN]
        return [one(port) for one in bad]
    return [one_of_crowd(port, data, kind != "fields") for data in crowd(kind)]


async def main(port, kind="mixed"):
    # Low priority: the clients represent other machines, which use no processor time of the daemon.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(10)
    tasks = [asyncio.create_task(one) for one in tasks_of(port, kind)]
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    await asyncio.wait(tasks)


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), *sys.argv[2:]))
