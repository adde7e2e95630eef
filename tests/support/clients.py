"""Client that uses the protocol without the SDK, and a daemon as a process."""

import asyncio
import contextlib
import json
import os
import signal
import sys
from pathlib import Path
from typing import ClassVar

from armgate.protocol import Connection, LocalProtocolError, Refusal, Side
from armgate.protocol import messages as m

PATIENCE = 20.0
"""Timeout for an event that must occur, s. No test depends on its length."""


async def until(condition, turns=100_000):
    """Run turns of the event loop until a condition holds."""
    for _ in range(turns):
        if condition():
            return
        await asyncio.sleep(0)
    raise AssertionError(f"the condition did not hold within {turns} turns of the event loop")


class Raw:
    """Connection of one client, which keeps all bytes that it receives."""

    opened: ClassVar = []

    def __init__(self, reader, writer):
        self.reader, self.writer = reader, writer
        self.connection = Connection(Side.CLIENT)
        self.raw = bytearray()
        self.waiting = []
        self.opened.append(self)

    @classmethod
    async def open(cls, port):
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    @classmethod
    async def hello(cls, port, name, role="controller"):
        """Connect, send a hello, and return the client after its welcome."""
        raw = await cls.open(port)
        raw.send(m.Hello(versions=(1,), name=name, role=role))
        raw.welcome = await raw.get(m.Welcome)
        return raw

    @classmethod
    async def close_all(cls):
        """Close all connections that tests left open."""
        while cls.opened:
            await cls.opened.pop().close()

    def send(self, *messages):
        self.writer.write(b"".join(self.connection.send(message) for message in messages))

    def send_bytes(self, data):
        self.writer.write(data)

    async def get(self, model, where=lambda message: True):
        """Return the next message of a model that meets a condition; drop all messages before it."""
        async with asyncio.timeout(PATIENCE):
            while True:
                message = await self.next()
                if isinstance(message, model) and where(message):
                    return message

    async def rest(self):
        """Return all messages until the server closes the connection."""
        found = []
        async with asyncio.timeout(PATIENCE):
            while True:
                try:
                    found.append(await self.next())
                except EOFError:
                    return found

    async def next(self):
        """Return the next message."""
        while not self.waiting:
            data = await self.reader.read(65536)
            if not data:
                raise EOFError("the server closed the connection")
            self.raw += data
            self.waiting += self.connection.receive(data)
        message = self.waiting.pop(0)
        assert not isinstance(message, Refusal), message
        return message

    async def acquire(self, robot, **more):
        """Acquire a robot; return the fence of the lease."""
        self.send(m.Acquire(robot=robot, **more))
        lease = await self.get((m.Lease, m.Error))
        assert isinstance(lease, m.Lease), lease
        return lease.fence

    async def close(self):
        self.writer.close()
        with contextlib.suppress(OSError):
            await self.writer.wait_closed()


class Mover:
    """Controller that moves one robot back and forth, tick by tick, and counts its verdicts."""

    def __init__(self, raw, robot, dq):
        self.raw, self.robot, self.dq = raw, robot, dq
        self.verdicts = []
        self.moving = asyncio.Event()

    @classmethod
    async def start(cls, port, robot, name="mover", dq=(0.0005, 0.0, 0.0)):
        mover = cls(await Raw.hello(port, name), robot, dq)
        mover.fence = await mover.raw.acquire(robot)
        mover.raw.send(m.Subscribe(robots=(robot,), fields=("setpoint",)))
        mover.task = asyncio.create_task(mover._run())
        return mover

    async def _run(self):
        seq = 0
        while True:
            message = await self.raw.get((m.State, m.Verdict))
            if isinstance(message, m.State):
                seq += 1
                dq = self.dq if seq // 40 % 2 == 0 else tuple(-u for u in self.dq)
                self.raw.send(
                    m.Command(robot=self.robot, fence=self.fence, seq=seq, tick=message.tick, dq=dq)
                )
            else:
                self.verdicts.append(message)
                self.moving.set()

    async def moves_on(self, count=5):
        """Wait for more commands that are not refused; others may be refused only because they are late.

        The first ones may also be refused because another robot has not reported its position yet.
        """
        goal = self.accepted + count
        async with asyncio.timeout(PATIENCE):
            while self.accepted < goal:
                self.moving.clear()
                await self.moving.wait()
        first = next(k for k, verdict in enumerate(self.verdicts) if verdict.outcome != "refused")
        busy = {"stale", "occupied"}  # causes of a busy machine
        assert _causes(self.verdicts[:first]) <= busy | {"link"}
        assert _causes(self.verdicts[first:]) <= busy

    @property
    def accepted(self):
        """Number of commands that were not refused."""
        return sum(verdict.outcome != "refused" for verdict in self.verdicts)

    async def ended(self):
        """Wait until the server has closed the connection."""
        with contextlib.suppress(EOFError, ConnectionError, LocalProtocolError):
            await asyncio.wait_for(self.task, PATIENCE)

    async def stop(self):
        """Stop sending commands, but stay connected."""
        self.task.cancel()
        await asyncio.wait([self.task])


def _causes(verdicts):
    """Return the causes of the refusals among verdicts."""
    return {verdict.reasons[0].cause for verdict in verdicts if verdict.outcome == "refused"}


class Process:
    """``armgate serve`` as a process."""

    def __init__(self, process, port):
        self.process, self.port = process, port

    @classmethod
    @contextlib.asynccontextmanager
    async def serving(cls, *arguments, port=0, host="127.0.0.1"):
        """Start a daemon that listens at ``host``, and kill it at the end unless it has ended."""
        process = await launch("serve", *map(str, arguments), "--port", str(port))
        try:
            async with asyncio.timeout(PATIENCE):
                line = (await process.stdout.readline()).decode()
            assert line.startswith(f"armgate: listening on {host}:"), line
            number = line.rpartition(":")[2].strip()
            yield cls(process, int(number) if number.isdigit() else 0)
        finally:
            await Raw.close_all()
            if process.returncode is None:
                process.kill()
            await process.communicate()

    def signal(self, number=signal.SIGTERM):
        self.process.send_signal(number)

    async def end(self):
        """Wait for the end; return the exit status and the lines of the log."""
        async with asyncio.timeout(PATIENCE):
            _, errors = await self.process.communicate()
        return self.process.returncode, [json.loads(line) for line in errors.decode().splitlines()]


async def launch(*arguments, env=None, stdin=None):
    """Start the command line as a process."""
    return await asyncio.create_subprocess_exec(
        sys.executable, "-m", "armgate.apps", *arguments,
        stdin=stdin, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        env=(os.environ if env is None else env) | {"COLUMNS": "200"}, cwd=Path(__file__).parents[2],
    )  # fmt: skip


async def run(*arguments):
    """Run a command; return its exit status, stdout and stderr."""
    process = await launch(*map(str, arguments))
    async with asyncio.timeout(PATIENCE):
        out, err = await process.communicate()
    return process.returncode, out.decode(), err.decode()
