"""The same search over sockets: clients of a real ``armgate serve``, which must then end with status 0."""

import asyncio
import signal
import sys
from contextlib import suppress
from pathlib import Path
from random import Random

from armgate.cell.cell import build_cell
from armgate.protocol import Connection, Refusal, Side
from armgate.protocol import messages as m
from tools.fuzz.valid import cells
from tools.fuzz.valid.generator import MessageGenerator
from tools.fuzz.valid.oracle import Expectations, Knowledge, ViolationError, require

_ROLES: tuple[m.Role, ...] = ("observer", "controller", "operator", "controller")
_LEAVE = 0.003
_TIMEOUT = 60.0
"""Timeout of an answer on a busy machine, s."""


class LiveClient:
    """Client on a socket.

    Args:
        knowledge: Knowledge of the client about the cell.
        rng: Source of all choices.
    """

    def __init__(self, knowledge: Knowledge, rng: Random) -> None:
        self.expects = Expectations(knowledge, exact=False)
        self.generator = MessageGenerator(rng, knowledge)
        self._connection = Connection(Side.CLIENT)
        self._arrival = asyncio.Event()
        self._writer: asyncio.StreamWriter
        self._task: asyncio.Task[None]

    async def open(self, port: int, name: str, role: m.Role) -> None:
        """Connect, send hello and wait for the welcome."""
        reader, self._writer = await asyncio.open_connection("127.0.0.1", port)
        self._task = asyncio.create_task(self._read(reader))
        self.send(m.Hello(id=0, versions=(1,), name=name, role=role))
        await self.answered()

    def send(self, message: m.Message) -> None:
        """Send a message."""
        self.expects.note_sent(message)
        self._writer.write(self._connection.send(message))

    async def answered(self) -> None:
        """Wait until all answers and verdicts have arrived.

        Raises:
            ViolationError: The server violated the specification.
            TimeoutError: The server did not answer in time.
        """
        async with asyncio.timeout(_TIMEOUT):
            while self.expects.waiting and not self.expects.ended and not self._task.done():
                await self.arrival()
        if self._task.done():
            self._task.result()

    async def arrival(self) -> None:
        """Wait until bytes arrive."""
        self._arrival.clear()
        await self._arrival.wait()

    async def leave(self) -> None:
        """Send bye and wait for the server's bye."""
        if not self._task.done():
            self.send(m.Bye())
        async with asyncio.timeout(_TIMEOUT):
            await self._task
        self._writer.close()
        with suppress(OSError):
            await self._writer.wait_closed()

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while data := await reader.read(1 << 16):
                for item in self._connection.receive(data):
                    if isinstance(item, Refusal):
                        raise ViolationError(f"the server sent an invalid message: {item}")
                    self.expects.check(item)
                self._arrival.set()
            require(self.expects.ended, "the server closed the connection without bye or a fatal error")
        finally:
            self._arrival.set()


class Live:
    """Daemon process and its clients.

    Args:
        folder: Folder for the cell's files.
        rng: Source of all choices.
        robots: Number of robots.
        joints: Largest number of joints of a robot.
    """

    def __init__(self, folder: Path, rng: Random, robots: int, joints: int) -> None:
        self._rng = rng
        self._cell = build_cell(cells.make(folder, rng, robots, joints))
        self._file = folder / "cell.yaml"

    async def run(self, clients: int, messages: int) -> None:
        """Send ``messages`` messages from each of ``clients`` clients, reset all stops, and end the daemon.

        Raises:
            ViolationError: The server violated the specification, or the daemon failed.
        """
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "armgate.apps", "serve", str(self._file), "--port", "0",
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        assert process.stdout is not None
        errors = asyncio.create_task(_all_of(process.stderr))
        try:
            line = (await process.stdout.readline()).decode()
            require("listening" in line, f"the daemon did not start: {line}")
            port = int(line.rpartition(":")[2])
            await asyncio.gather(*(self._converse(port, number, messages) for number in range(clients)))
            await self._recover(port)
            process.send_signal(signal.SIGTERM)
            status = await asyncio.wait_for(process.wait(), _TIMEOUT)
            require(status == 0, f"the daemon ended with {status}: {(await errors)[-3000:]}")
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
            await errors

    def _client(self) -> LiveClient:
        joints = {robot.name: robot.model.n for robot in self._cell.robots}
        return LiveClient(Knowledge(tuple(joints), joints), self._rng)

    async def _converse(self, port: int, number: int, messages: int) -> None:
        client, sent = self._client(), 0
        await client.open(port, f"c{number}", _ROLES[number % len(_ROLES)])
        while sent < messages:
            if client.expects.ended or self._rng.random() < _LEAVE:
                await client.leave()
                client = self._client()
                await client.open(port, f"c{number}", self._rng.choice(_ROLES))
            for _ in range(self._rng.choice((1, 1, 5, 40))):
                client.send(client.generator.next())
                sent += 1
            if self._rng.random() < 0.5:
                await client.answered()
        await client.answered()
        await client.leave()

    async def _recover(self, port: int) -> None:
        """Reset every stop and acquire every robot, which shows that the daemon still works."""
        operator = self._client()
        await operator.open(port, "op", "operator")
        sent = 0
        async with asyncio.timeout(_TIMEOUT):
            while stops := await self._stops(operator):
                for stop in stops:
                    sent += 1
                    operator.send(m.Reset(id=sent, stop=stop))
                await operator.answered()
        for number, robot in enumerate(self._cell.robots):
            operator.send(m.Acquire(id=2**30 + number, robot=robot.name))
        await operator.answered()
        held = set(operator.expects.known.fences)
        require(held == {robot.name for robot in self._cell.robots}, f"only {held} can be acquired")
        await operator.leave()

    async def _stops(self, operator: LiveClient) -> set[int]:
        """Return the stops in force, from a state some ticks later."""
        known = operator.expects.known
        operator.send(m.Subscribe(id=2**31 - 1, fields=("stops",)))
        await operator.answered()
        begin = dict(known.ticks)
        while any(known.ticks.get(name, 0) < begin.get(name, 0) + 20 for name in known.robots):
            await operator.arrival()
        return set(known.in_force)


async def _all_of(stream: asyncio.StreamReader | None) -> str:
    assert stream is not None
    return (await stream.read()).decode(errors="replace")
