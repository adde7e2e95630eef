"""Many bad clients, and crowds that connect and disconnect: their effect on a controller and on memory.

The short forms run with all tests. ``make soak`` sets ARMGATE_SOAK=1 for the long ones.
"""

import asyncio
import contextlib
import os
import sys
from dataclasses import dataclass
from math import comb
from pathlib import Path
from time import monotonic

import pytest

from armgate.protocol import messages as m
from support import abusers
from support.cells import arms_yaml
from support.clients import PATIENCE, Process, Raw

LONG = bool(os.environ.get("ARMGATE_SOAK"))
TICKS = 5000 if LONG else 300
BLOCK = 500 if LONG else 100
STEPS = 100_000 if LONG else 3000
WARM = 10_000 if LONG else 1000
MEGABYTES = 5.0


@dataclass
class Seen:
    """Number of commands, of refused ones, of ones decided for a later tick; largest delay of a state, s."""

    commands: int = 0
    refused: int = 0
    late: int = 0
    latest: float = 0.0

    def __add__(self, other):
        return Seen(
            self.commands + other.commands,
            self.refused + other.refused,
            self.late + other.late,
            max(self.latest, other.latest),
        )


class Controller:
    """Controller that sends a command as soon as a state arrives."""

    def __init__(self, raw, fence):
        self.raw, self.fence, self.seq, self.tick = raw, fence, 0, 0
        self.seen, self.causes, self.earliest = Seen(), set(), float("inf")
        self.news = asyncio.Event()
        self.task = asyncio.create_task(self._run())

    @classmethod
    async def start(cls, port):
        raw = await Raw.hello(port, "good")
        fence = await raw.acquire("A")
        raw.send(m.Subscribe(robots=("A",), fields=("setpoint",)))
        return cls(raw, fence)

    async def over(self, ticks):
        """Return the figures of the next ``ticks`` ticks."""
        self.seen, until = Seen(), self.tick + ticks
        async with asyncio.timeout(PATIENCE + ticks):
            while self.tick < until:
                assert not self.task.done(), self.task.exception()
                self.news.clear()
                await self.news.wait()
        return self.seen

    async def _run(self):
        try:
            while True:
                self._take(await self.raw.next())
        finally:
            self.news.set()

    def _take(self, message):
        if isinstance(message, m.State):
            self.tick = message.tick
            came = monotonic() - message.time
            self.earliest = min(self.earliest, came)
            self.seen.latest = max(self.seen.latest, came - self.earliest)
            self.seq += 1
            dq = (0.0005 if self.seq // 40 % 2 == 0 else -0.0005, 0.0, 0.0)
            self.raw.send(m.Command(robot="A", fence=self.fence, seq=self.seq, tick=self.tick, dq=dq))
            self.news.set()
        elif isinstance(message, m.Verdict):
            self.seen.commands += 1
            self.seen.refused += message.outcome == "refused"
            self.causes |= {message.reasons[0].cause} if message.outcome == "refused" else set()
            self.seen.late += message.target is not None and message.target > message.tick + 1


def more_than_by_chance(many, few):
    """Return True if ``many`` is significantly larger than ``few``: a one-sided sign test with p < 0.01.

    Both are numbers of events in equal times. The machine itself delays some commands: 1 event against 0 is
    no evidence, 7 against 0 are.
    """
    total = many + few
    return sum(comb(total, k) for k in range(many, total + 1)) < 0.01 * 2**total


@contextlib.asynccontextmanager
async def abused(port, kind="mixed"):
    process = await asyncio.create_subprocess_exec(
        sys.executable, abusers.__file__, str(port), kind, stdout=asyncio.subprocess.PIPE
    )
    try:
        assert await process.stdout.readline() == b"ready\n"
        yield
    finally:
        process.kill()
        await process.communicate()


@pytest.mark.slow
async def test_bad_clients_hardly_affect_a_controller(tmp_path):
    """Blocks with and without bad clients alternate, so that the machine's own noise is in both."""
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server="{handshake_timeout: 1.0}"))
    without, among = Seen(), Seen()
    async with Process.serving(config) as daemon:
        good = await Controller.start(daemon.port)
        for _ in range(TICKS // BLOCK):
            without += await good.over(BLOCK)
            async with abused(daemon.port):
                among += await good.over(BLOCK)
        good.task.cancel()
        daemon.signal()
        status, log = await daemon.end()
    assert status == 0
    reasons = {line["reason"].partition(":")[0] for line in log if line["event"] == "gone"}
    print_figures(f"without: {without}", f"among bad clients: {among}", f"ended: {sorted(reasons)}")
    assert {"frame_too_large"} <= reasons
    assert good.causes <= {"stale", "occupied"}  # refused only because of lateness
    assert among.commands >= BLOCK * (TICKS // BLOCK) / 2
    if LONG:  # times mean nothing on a machine with other load
        assert not more_than_by_chance(among.refused, without.refused)
        assert not more_than_by_chance(among.late, without.late)


CROWDS = ("pings", "subscribes", "describes", "large", "crooked", "fields")
CROWD_BLOCK = 300 if LONG else 40
CROWD_BURST = 40
"""Ticks in which a crowd uses up the bursts of its rate limits."""

SHARE = 0.8
"""Share of a core that the daemon may use because of one observer, after its bursts.

Measured on a quiet machine: 0.45 to 0.57. The rate limits bound messages, not processor time. A daemon
without limits uses all of a core.
"""


@pytest.mark.slow
async def test_one_observer_on_many_connections_delays_no_tick(tmp_path):
    """Its connections share one rate limit; their messages are handled after ticks and lease holders."""
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml())
    without, among, shares = Seen(), {kind: Seen() for kind in CROWDS}, {}
    async with Process.serving(config) as daemon:
        good = await Controller.start(daemon.port)
        for _ in range(5 if LONG else 1):
            for kind in CROWDS:
                without += await good.over(CROWD_BURST + CROWD_BLOCK)
                async with abused(daemon.port, kind):
                    among[kind] += await good.over(CROWD_BURST)
                    begin, used = monotonic(), cpu(daemon.process.pid)
                    among[kind] += await good.over(CROWD_BLOCK)
                    shares[kind] = (cpu(daemon.process.pid) - used) / (monotonic() - begin)
        good.task.cancel()
        daemon.signal()
        status, _ = await daemon.end()
    assert status == 0
    figures = (f"among {kind}: {seen}, {shares[kind]:.2f} of a core" for kind, seen in among.items())
    print_figures(f"without: {without}", *figures)
    assert max(shares.values()) <= SHARE, shares
    assert good.causes <= {"stale", "occupied"}  # refused only because of lateness
    if LONG:  # times mean nothing on a machine with other load
        for kind, seen in among.items():
            assert seen.latest <= without.latest + 0.05, kind
        refused, late = (sum(getattr(seen, name) for seen in among.values()) for name in ("refused", "late"))
        assert not more_than_by_chance(refused, without.refused)
        assert not more_than_by_chance(late, without.late)


def cpu(pid):
    """Return the processor time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def print_figures(*lines):
    """Print figures, which pytest shows with -s and in the report of a failure."""
    sys.stdout.write("\n" + "\n".join(lines) + "\n")


# --- memory -----------------------------------------------------------------------------------------------


def memory(pid):
    """Return the resident memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def guest(port, number):
    """Connect, observe, and disconnect: with a bye, without a bye, or in the middle of a message."""
    raw = await Raw.hello(port, f"guest{number}", "observer")
    raw.send(m.Describe(), m.Subscribe(), m.Stop.model_construct(type="stop", robot=7, id=1))
    await raw.get(m.Error)
    if number % 3 == 0:
        raw.send(m.Bye())
        await raw.rest()
    elif number % 3 == 1:
        raw.send_bytes(b"\x00\x00\x00\x09abc")
    Raw.opened.remove(raw)
    await raw.close()


@pytest.mark.slow
async def test_the_daemons_memory_is_flat_while_clients_come_and_go(tmp_path):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server="{connection_rate: 10000}"))
    marks = []
    async with Process.serving(config, "--lockstep", "good") as daemon:
        raw = await Raw.hello(daemon.port, "good")
        fence = await raw.acquire("A")
        raw.send(m.Subscribe(robots=("A",), fields=("setpoint",)))
        for step in range(STEPS):
            state = await raw.get(m.State)
            if step % 20 == 0:
                await guest(daemon.port, step // 20)
            if step % 1000 == 999:
                raw.send(m.Release(robot="A", fence=fence))
                await raw.get(m.Lease)
                fence = await raw.acquire("A")
            if step >= WARM and step % (STEPS // 20) == 0:
                marks.append(memory(daemon.process.pid))
            raw.raw.clear()
            raw.send(m.Signal(name=f"s{step % 7}", value=(float(step),)))
            dq = (0.0005 if step // 40 % 2 == 0 else -0.0005, 0.0, 0.0)
            raw.send(m.Command(robot="A", fence=fence, seq=step, tick=state.tick, dq=dq))
        await raw.get(m.State)
    shown = [round(mark, 1) for mark in marks]
    print_figures(f"memory over {STEPS} steps, MB: {shown}")
    assert max(marks) - min(marks) <= 2 * MEGABYTES
    assert abs(marks[-1] - marks[0]) <= MEGABYTES
