"""``armgate robot-server`` as a process; actions of an operator at a daemon that uses a robot server."""

import asyncio
import contextlib
import json
import signal

from armgate.protocol import messages as m
from support.clients import PATIENCE, Raw, launch


class RobotServer:
    """Process of a robot server, and its log."""

    def __init__(self, process, socket):
        self.process, self.socket = process, socket
        self.log = []

    @classmethod
    @contextlib.asynccontextmanager
    async def running(cls, *configs, socket):
        """Start a robot server, and kill it at the end unless it has ended."""
        process = await launch("robot-server", *map(str, configs), "--socket", str(socket))
        try:
            async with asyncio.timeout(PATIENCE):
                line = (await process.stdout.readline()).decode()
            assert line == f"armgate: robot server at {socket}\n", (line, await process.stderr.read())
            yield cls(process, socket)
        finally:
            if process.returncode is None:
                process.kill()
            await process.communicate()

    async def logs(self, event):
        """Return the next line of the log about this event."""
        async with asyncio.timeout(PATIENCE):
            while line := await self.process.stderr.readline():
                self.log.append(json.loads(line))
                if self.log[-1]["event"] == event:
                    return self.log[-1]
        raise AssertionError(f"no {event} in {self.log}")

    def signal(self, number=signal.SIGTERM):
        self.process.send_signal(number)

    async def end(self):
        """Wait for the end; return the exit status."""
        async with asyncio.timeout(PATIENCE):
            await self.process.communicate()
        return self.process.returncode


async def stopped_by_the_gate(raw, robots):
    """Wait until the gate has stopped all of these robots; return the reasons."""
    reasons = {}
    while set(reasons) < set(robots):
        stopped = await raw.get(m.Stopped, lambda s: s.by == "gate")
        reasons.update(dict.fromkeys(stopped.robots, stopped.reason))
    return reasons


async def lift_stops(port):
    """Reset every stop as an operator until all robots are ready and not stopped; return the last state."""
    operator = await Raw.hello(port, "operator", "operator")
    operator.send(m.Subscribe())
    while True:
        state = await operator.get(m.State)
        stops = {stop for entry in state.entries for stop in entry.stops}
        if not stops and all(entry.link == "ready" for entry in state.entries):
            return state
        for number, stop in enumerate(sorted(stops)):
            operator.send(m.Reset(stop=stop, id=number + 1))
            await operator.get((m.Resumed, m.Error), lambda x, re=number + 1: x.re == re)
