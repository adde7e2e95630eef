"""A proxy in this process that does to a stream what networks do.

Bytes stay in order and none is lost, as TCP has it: what a lost packet looks like above TCP is a stall.
Chance is seeded, so a run can be had again.
"""

import asyncio
import random
import socket
import struct
from collections.abc import Callable

from armgate.conformance.faults import Faults

_CHUNK = 65536


class Proxy:
    """Listens on loopback and passes connections on, with faults.

    Args:
        host: Where the server is.
        port: Its port.
        faults: What happens on the way.
        seed: Of what is left to chance.
    """

    def __init__(self, host: str, port: int, faults: Faults, seed: int = 1) -> None:
        self.faults = faults
        self.port = 0
        self._to = (host, port)
        self._chance = random.Random(seed)  # noqa: S311 (not for secrets)
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._open = asyncio.Event()
        self._open.set()

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
        """From now nothing passes in either direction, and no side is told."""
        self._open.clear()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        writers = [writer]
        try:
            inner, outer = await asyncio.open_connection(*self._to, limit=_CHUNK)
            writers.append(outer)
            async with asyncio.TaskGroup() as group:
                group.create_task(self._way(reader, outer, _Meter(self.faults, writer)))
                group.create_task(self._way(inner, writer, None))
        except* (OSError, asyncio.CancelledError):
            pass  # one side is gone: the other is closed below
        finally:
            for each in writers:
                each.transport.abort()
            self._tasks.discard(task)

    async def _way(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, meter: "_Meter | None"
    ) -> None:
        """One direction: bytes come in as they come, and go out when it is their time."""
        pipe: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(maxsize=1024)
        async with asyncio.TaskGroup() as group:
            group.create_task(self._take_in(reader, pipe))
            await self._give_out(pipe, writer, meter)

    async def _take_in(self, reader: asyncio.StreamReader, pipe: asyncio.Queue[tuple[float, bytes]]) -> None:
        size = self.faults.slice or _CHUNK
        loop, due = asyncio.get_running_loop(), 0.0
        stall_at = loop.time() + self._until_stall()
        while data := await reader.read(_CHUNK):
            now = loop.time()
            if now >= stall_at:
                due = max(due, now) + self.faults.stall * self._chance.uniform(0.5, 1.0)
                stall_at = due + self._until_stall()
            for start in range(0, len(data), size):
                piece = data[start : start + size]
                due = max(due, now + self._delay())
                if self.faults.bandwidth:
                    due += len(piece) / self.faults.bandwidth
                await pipe.put((due, piece))
        await pipe.put((due, b""))

    async def _give_out(
        self,
        pipe: asyncio.Queue[tuple[float, bytes]],
        writer: asyncio.StreamWriter,
        meter: "_Meter | None",
    ) -> None:
        loop = asyncio.get_running_loop()
        while True:
            due, piece = await pipe.get()
            if (wait := due - loop.time()) > 0:
                await asyncio.sleep(wait)
            await self._open.wait()
            if not piece:
                writer.write_eof()
                return
            writer.write(piece if meter is None else piece[: meter.room(len(piece))])
            await writer.drain()
            if meter is not None and meter.full:
                await meter.end(writer, self.hold)
                return
            if self.faults.slice:
                await asyncio.sleep(0)  # a packet of its own, where the kernel does not join them again

    def _delay(self) -> float:
        return max(0.0, self.faults.latency + self.faults.jitter * self._chance.uniform(-1.0, 1.0))

    def _until_stall(self) -> float:
        return self._chance.expovariate(1.0 / self.faults.every) if self.faults.stall else float("inf")


class _Meter:
    """Counts the bytes to the server, and ends the connection where the faults say so."""

    def __init__(self, faults: Faults, client: asyncio.StreamWriter) -> None:
        self._faults = faults
        self._client = client
        limits = [n for n in (faults.cut, faults.reset, faults.silence) if n]
        self._left = min(limits) if limits else None

    @property
    def full(self) -> bool:
        """Whether no byte may pass any more."""
        return self._left == 0

    def room(self, count: int) -> int:
        """How many of so many bytes still pass."""
        if self._left is None:
            return count
        passing = min(count, self._left)
        self._left -= passing
        return passing

    async def end(self, server: asyncio.StreamWriter, hold: Callable[[], None]) -> None:
        """Close, reset, or let nothing pass any more."""
        faults = self._faults
        least = min(n for n in (faults.cut, faults.reset, faults.silence) if n)
        if least == faults.silence:
            hold()
            await asyncio.Event().wait()
        for writer in (self._client, server):
            if least == faults.reset:
                sock = writer.get_extra_info("socket")
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                writer.transport.abort()
            else:
                writer.close()
