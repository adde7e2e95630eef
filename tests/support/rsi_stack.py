"""Virtual KRC, robot server and daemon, each as a process."""

import asyncio
import contextlib
import json

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.protocol import messages as m
from support.clients import PATIENCE, Mover, Process, Raw, launch
from support.ports import free_ports
from support.robot_servers import RobotServer, lift_stops, stopped_by_the_gate
from support.rsi import cell_text
from support.setpoints import check_setpoints

DQ = (0.004, -0.002, 0.002, 0.0, 0.002, 0.0)
"""An eighth of the largest speed at 12 ms: the drives can stop within a cycle without a reply."""
TIMEOUT = 150
"""Late cycles that the KRC allows (1.8 s), because other tests on the machine cause some."""


class KrcProcess:
    """``armgate krc`` as a process."""

    def __init__(self, process):
        self.process = process

    @classmethod
    @contextlib.asynccontextmanager
    async def running(cls, *options):
        """Start a virtual KRC, and kill it at the end unless it has ended."""
        process = await launch("krc", *map(str, options), stdin=asyncio.subprocess.PIPE)
        try:
            krc = cls(process)
            assert (await krc.line()).startswith("armgate: krc"), await process.stderr.read()
            yield krc
        finally:
            if process.returncode is None:
                process.kill()
            await process.communicate()

    async def line(self):
        async with asyncio.timeout(PATIENCE):
            return (await self.process.stdout.readline()).decode()

    async def tell(self, line):
        """Send a line to the KRC's console; return the answer."""
        self.process.stdin.write(f"{line}\n".encode())
        answer = json.loads(await self.line())
        assert answer["ok"], answer
        return answer

    async def until(self, condition):
        """Return the first status that meets a condition."""
        async with asyncio.timeout(PATIENCE):
            while True:
                status = await self.tell("status")
                if condition(status):
                    return status
                await asyncio.sleep(0.01)

    async def breaks_off(self):
        """Wait until the KRC has ended its program by itself; return the status."""
        status = await self.until(lambda s: s["state"] not in ("waiting", "running"))
        assert status["state"] == "broken_off"
        return status

    async def starts_anew(self):
        """Acknowledge at the KRC, and start its program from the beginning."""
        await self.tell("reset")
        await self.tell("start")

    async def rests(self, cycles=10):
        """Wait until the setpoint has not changed for ``cycles`` cycles; return the status."""
        status = await self.tell("status")
        while True:
            until = status["cycles"] + cycles
            later = await self.until(lambda s, until=until: s["cycles"] >= until)
            if later["setpoint"] == status["setpoint"]:
                return later
            status = later


class RsiStack:
    """Processes of the stack; `begin` restarts those that were killed.

    Args:
        folder: Folder for the files.
    """

    def __init__(self, folder):
        self.port, self.krc_port = free_ports(2)
        self.file = cell_text(
            folder, cycle=0.012, listen=f"127.0.0.1:{self.port}", krc="127.0.0.1", timeout=TIMEOUT,
            late_in_a_row=40, silence="300 ms", axiscorr="{A: 400.0}",
        )  # fmt: skip
        self.file.write_text(self.file.read_text() + "max_age_ticks: 1000\n")
        self.cell = build_cell(load_config([self.file]))
        self.folder, self.socket = folder, folder / "s"
        self.exits = contextlib.AsyncExitStack()
        self.robots = self.krc = self.daemon = None
        self.movers, self.dq = [], DQ

    async def begin(self):
        """Restart missing processes, reset the stops, and return a controller that moves the robot."""
        await self.leave()
        await self.serve_robots()
        if self.krc is None:
            self.krc = await self.exits.enter_async_context(
                KrcProcess.running(
                    "--profile", "krc4-rsi3", "--cycle", 12, "--config", self.folder / "krc.xml",
                    "--to", f"127.0.0.1:{self.port}", "--cell", self.file, "--robot", "R", "--precision", 6,
                    "--timeout", TIMEOUT, "--axiscorr", 400, "--axiscorrmon", 401, "--stopped",
                    # The worst case: with the same port a new run is harder to distinguish from the old one.
                    "--port", self.krc_port,
                    "--log", self.folder / "krc.log", "--trace", self.folder / "krc.csv",
                )
            )  # fmt: skip
        anew = self.daemon is None
        await self.serve()
        status = await self.krc.tell("status")
        if status["state"] != "running" or status["delay"] > TIMEOUT // 10:  # Delay accumulates over the run
            await self.krc.tell("restart")
        if not anew and (await self.krc.tell("status"))["runs"] != status["runs"]:
            watch = await self.watch()
            await watch.get(m.State, lambda state: state.entries[0].link in ("lost", "faulted"))
        await self.lift_stops()
        self.eye = await Raw.hello(self.daemon.port, "eye")
        return await self.moves()

    async def leave(self):
        """Disconnect all clients."""
        for mover in self.movers:
            mover.task.cancel()
        await asyncio.gather(*(mover.task for mover in self.movers), return_exceptions=True)
        self.movers.clear()
        await Raw.close_all()

    async def watch(self):
        """Return an observer that receives all states."""
        raw = await Raw.hello(self.daemon.port, "watch", "observer")
        raw.send(m.Subscribe())
        return raw

    async def stopped(self):
        """Wait until the gate has stopped the robot; return the reason."""
        return (await stopped_by_the_gate(self.eye, ("R",)))["R"]

    async def serve_robots(self):
        """Start a robot server unless one runs."""
        if self.robots is None or self.robots.process.returncode is not None:
            running = RobotServer.running(self.file, socket=self.socket)
            self.robots = await self.exits.enter_async_context(running)

    async def serve(self):
        """Start a daemon unless one runs."""
        if self.daemon is None or self.daemon.process.returncode is not None:
            running = Process.serving(self.file, "--robot-server", self.socket)
            self.daemon = await self.exits.enter_async_context(running)

    async def lift_stops(self):
        """Reset all stops as an operator."""
        await asyncio.wait_for(lift_stops(self.daemon.port), PATIENCE)

    async def moves(self):
        """Return a controller whose commands have changed the setpoint of the KRC."""
        before = (await self.krc.tell("status"))["setpoint"]
        watch = await self.watch()
        await watch.get(m.State, lambda state: state.entries[0].holder is None)
        # Directions alternate, so that many tests do not move the robot to a limit.
        mover = await Mover.start(self.daemon.port, "R", "mover", self.dq)
        self.dq = tuple(-u for u in self.dq)
        self.movers.append(mover)
        await mover.moves_on(20)
        await self.krc.until(lambda status: status["setpoint"] != before)
        return mover

    async def nothing_moves(self):
        """Check that the robot rests, no client can acquire it, and the setpoint of the KRC stays."""
        rests = await self.krc.rests()
        raw = await Raw.hello(self.daemon.port, "hopeful")
        raw.send(m.Acquire(robot="R"))
        assert (await raw.get((m.Lease, m.Error))).type == "error"
        assert (await self.krc.rests())["setpoint"] == rests["setpoint"]

    async def goes_on(self):
        """Check that the robot rests until the stops are reset, and that a controller can then move it."""
        await self.nothing_moves()
        await self.lift_stops()
        await self.moves()
        self.within_bounds()

    def within_bounds(self):
        """Check that every setpoint so far was within the robot's bounds and no drive faulted."""
        moved, _ = check_setpoints(self.folder / "krc.csv", self.cell.robots[0])
        assert moved > 20
        assert '"faulted"' not in (self.folder / "krc.log").read_text()
