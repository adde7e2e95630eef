"""Network faults between kit and server: the values of ``--faults``, and the proxy that injects them.

Bytes stay in order and are not lost, as in TCP. Above TCP, a lost packet appears as a stall. Random numbers
are seeded, so that a run can be repeated.
"""

import asyncio
import random
import re
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass, fields

_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "b": 1.0, "k": 1024.0, "m": 1024.0**2}
_NUMBER = re.compile(r"([0-9]*\.?[0-9]+)(ms|s|b|k|m)?", re.IGNORECASE)
_COUNTS = ("slice", "cut", "reset", "silence")
_TIMES = ("latency", "jitter", "every", "stall")
_CHUNK = 65536


class FaultError(Exception):
    """The value of ``--faults`` is invalid."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults in both directions of a connection; 0 disables one.

    Attributes:
        latency: Delay of every byte, s.
        jitter: Largest deviation of the delay, s; the order of bytes stays, as in TCP.
        stall: Longest time for which no byte passes, s; each stall lasts between half of it and all of it.
        every: Mean time between two stalls, s.
        slice: Largest number of bytes in a packet.
        bandwidth: Bytes per second.
        cut: Number of bytes to the server after which the connection is closed.
        reset: Number of bytes to the server after which the connection is reset.
        silence: Number of bytes to the server after which no byte passes, with the connection still open.
    """

    latency: float = 0.0
    jitter: float = 0.0
    stall: float = 0.0
    every: float = 2.0
    slice: int = 0
    bandwidth: float = 0.0
    cut: int = 0
    reset: int = 0
    silence: int = 0

    @classmethod
    def parse(cls, text: str) -> "Faults":
        """Return the faults of a text such as ``latency=80ms,jitter=40ms,stall=400ms,every=2s``.

        Raises:
            FaultError: The text is invalid; the error lists the valid names.
        """
        known = {field.name for field in fields(cls)}
        values: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            name, _, number = part.strip().partition("=")
            match = _NUMBER.fullmatch(number.strip())
            if name not in known or match is None:
                names = ", ".join(field.name for field in fields(cls))
                raise FaultError(
                    f"--faults: {part!r} is not a fault; write NAME=NUMBER with one of {names}, "
                    "times as 80ms or 0.3s, sizes as 100 or 64k"
                )
            value = float(match[1]) * _UNITS[_unit(name, match[2])]
            values[name] = int(value) if name in _COUNTS else value
        return cls(**values)  # type: ignore[arg-type]

    @property
    def delay(self) -> float:
        """Largest additional delay of an answer, s."""
        return 2 * (self.latency + self.jitter + self.stall)

    @property
    def ends_at(self) -> int | None:
        """Number of bytes to the server after which the connection ends; None if it is not ended."""
        return min((n for n in (self.cut, self.reset, self.silence) if n), default=None)


def _unit(name: str, unit: str | None) -> str:
    short = (unit or "").lower()
    if name in _TIMES and short not in ("", "s", "ms"):
        raise FaultError(f"--faults: {name} is a time: write it as 80ms or 0.3s")
    if name not in _TIMES and short in ("s", "ms"):
        raise FaultError(f"--faults: {name} is a size in bytes: write it as 100 or 64k")
    return short


class Proxy:
    """Proxy that listens on loopback and forwards connections to a server, with faults.

    Args:
        host: Host of the server.
        port: Its port.
        faults: Faults to inject.
        seed: Seed of the random numbers.
    """

    def __init__(self, host: str, port: int, faults: Faults, seed: int = 1) -> None:
        self.faults = faults
        self.port = 0
        self._to = (host, port)
        self._random = random.Random(seed)  # noqa: S311 (not for secrets)
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._flowing = asyncio.Event()
        self._flowing.set()

    async def __aenter__(self) -> "Proxy":
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0, limit=_CHUNK)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)

    def hold(self) -> None:
        """Forward nothing more in either direction, with all connections still open."""
        self._flowing.clear()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        writers = [writer]
        try:
            from_server, to_server = await asyncio.open_connection(*self._to, limit=_CHUNK)
            writers.append(to_server)
            async with asyncio.TaskGroup() as group:
                group.create_task(self._forward(reader, to_server, _ByteLimit(self.faults, writer)))
                group.create_task(self._forward(from_server, writer, None))
        except* (OSError, asyncio.CancelledError):
            pass  # one side is closed: the other one is closed below
        finally:
            for each in writers:
                each.transport.abort()
            self._tasks.discard(task)

    async def _forward(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, limit: "_ByteLimit | None"
    ) -> None:
        """Forward one direction: read bytes as they come, write them when they are due."""
        pipe: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(maxsize=1024)
        async with asyncio.TaskGroup() as group:
            group.create_task(self._read(reader, pipe))
            await self._write(pipe, writer, limit)

    async def _read(self, reader: asyncio.StreamReader, pipe: asyncio.Queue[tuple[float, bytes]]) -> None:
        size = self.faults.slice or _CHUNK
        loop, due = asyncio.get_running_loop(), 0.0
        stall_at = loop.time() + self._time_to_stall()
        while data := await reader.read(_CHUNK):
            now = loop.time()
            if now >= stall_at:
                due = max(due, now) + self.faults.stall * self._random.uniform(0.5, 1.0)
                stall_at = due + self._time_to_stall()
            for start in range(0, len(data), size):
                piece = data[start : start + size]
                due = max(due, now + self._delay())
                if self.faults.bandwidth:
                    due += len(piece) / self.faults.bandwidth
                await pipe.put((due, piece))
        await pipe.put((due, b""))

    async def _write(
        self,
        pipe: asyncio.Queue[tuple[float, bytes]],
        writer: asyncio.StreamWriter,
        limit: "_ByteLimit | None",
    ) -> None:
        loop = asyncio.get_running_loop()
        while True:
            due, piece = await pipe.get()
            if (wait := due - loop.time()) > 0:
                await asyncio.sleep(wait)
            await self._flowing.wait()
            if not piece:
                writer.write_eof()
                return
            writer.write(piece if limit is None else piece[: limit.take(len(piece))])
            await writer.drain()
            if limit is not None and limit.reached:
                await limit.end(writer, self.hold)
                return
            if self.faults.slice:
                await asyncio.sleep(0)  # so that each slice is a packet, unless the kernel joins them again

    def _delay(self) -> float:
        return max(0.0, self.faults.latency + self.faults.jitter * self._random.uniform(-1.0, 1.0))

    def _time_to_stall(self) -> float:
        return self._random.expovariate(1.0 / self.faults.every) if self.faults.stall else float("inf")


class _ByteLimit:
    """Limit of the bytes to the server, from the faults; the connection ends when it is reached."""

    def __init__(self, faults: Faults, client: asyncio.StreamWriter) -> None:
        self._faults = faults
        self._client = client
        self._left = faults.ends_at

    @property
    def reached(self) -> bool:
        """True if no byte may pass any more."""
        return self._left == 0

    def take(self, count: int) -> int:
        """Return how many of ``count`` bytes still pass, and count them."""
        if self._left is None:
            return count
        passing = min(count, self._left)
        self._left -= passing
        return passing

    async def end(self, server: asyncio.StreamWriter, hold: Callable[[], None]) -> None:
        """Close the connection, reset it, or let no byte pass any more."""
        faults = self._faults
        if faults.ends_at == faults.silence:
            hold()
            await asyncio.Event().wait()
        for writer in (self._client, server):
            if faults.ends_at == faults.reset:
                sock = writer.get_extra_info("socket")
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                writer.transport.abort()
            else:
                writer.close()
