"""The RSI link over UDP with `armgate krc` as a process of its own, by the wall clock.

A busy machine is sometimes late: the link holds the robot, and starts again from rest. Single faults are
tested in the whole stack (`tests/e2e`), and with injected time.
"""

import asyncio
import contextlib
import csv
import math
import socket

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.events import LinkChange, Plan, PlanKey, Tick
from armgate.links.rsi.probe import probe_size
from armgate.links.rsi.setup import setup_of
from armgate.links.rsi.udp_link import RsiUdpLink
from support.clients import PATIENCE
from support.krcs import krc_file
from support.ports import free_ports
from support.rsi import SEND, SIX, cell_text
from support.rsi_stack import KrcProcess
from support.setpoints import check_setpoints

STEP = (4e-4, -2e-4, 2e-4, 0.0, 0.0, 0.0)


class Daemon:
    """Substitute for the daemon: it offers the link a plan at each tick while ``moving``."""

    def __init__(self, link):
        self.link, self.events, self.news = link, [], asyncio.Event()
        self.moving = False

    def __call__(self, event):
        self.events.append(event)
        self.news.set()
        if self.moving and isinstance(event, Tick):
            key = PlanKey("d1", 0, event.tick + 1, event.index)
            increments = tuple(tuple(share * u for u in STEP) for share in (1.0, 0.6, 0.3, 0.0))
            self.link.offer(Plan("R", key, event.tick, increments))

    @property
    def changes(self):
        return [event.state.value for event in self.events if isinstance(event, LinkChange)]

    @property
    def ticks(self):
        return [event for event in self.events if isinstance(event, Tick)]

    async def until(self, condition):
        async with asyncio.timeout(PATIENCE):
            while not condition():
                self.news.clear()
                await self.news.wait()

    async def further(self, ticks):
        goal = len(self.ticks) + ticks
        await self.until(lambda: len(self.ticks) >= goal)


class Station:
    """The KRC's process and the link."""

    def __init__(self, krc, link, daemon):
        self.krc, self.link, self.daemon = krc, link, daemon

    async def rests(self):
        """Send no commands; return the KRC's status when its setpoint equals the setpoint of the link."""
        self.daemon.moving = False
        async with asyncio.timeout(PATIENCE):
            while True:
                await self.daemon.further(5)
                status, tick = await self.krc.tell("status"), self.daemon.ticks[-1]
                shown = map(math.degrees, tick.setpoint)
                gaps = [abs(a - b) for a, b in zip(shown, status["setpoint"].values(), strict=True)]
                if max(gaps) < 2e-6 and not self.link.remaining:
                    return status


@contextlib.asynccontextmanager
async def station(folder, *options, mode, krc_mode=None, file=None, becomes="ready"):
    port = free_ports(1)[0]
    file = cell_text(
        folder, cycle=0.012, listen=f"127.0.0.1:{port}", krc="127.0.0.1", timeout=10**6,
        late_in_a_row=10**6, silence="1 s", mode=mode, file=file,
    )  # fmt: skip
    cell = build_cell(load_config([file]))
    driven = RsiUdpLink(setup_of(cell, cell.robots[0]), "d1")
    daemon = Daemon(driven)
    await driven.open(daemon)
    try:
        async with KrcProcess.running(
            "--profile", "krc4-rsi3", "--cycle", 12, "--config", folder / "krc.xml",
            "--to", f"127.0.0.1:{port}", "--cell", file, "--robot", "R", "--timeout", 10**6,
            "--axiscorr", 400, "--axiscorrmon", 401, "--precision", 6, "--mode", krc_mode or mode,
            "--trace", folder / "krc.csv", *options,
        ) as krc:  # fmt: skip
            await daemon.until(lambda: daemon.changes == [becomes])
            yield Station(krc, driven, daemon), cell.robots[0]
    finally:
        driven.close()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["absolute", "relative"])
async def test_a_bad_network_holds_the_robot_and_never_faults_a_drive(tmp_path, mode):
    bad = ("--loss", "0.05", "--duplicate", "0.05", "--reorder", "0.05", "--jitter", "6", "--seed", "3")
    async with station(tmp_path, *bad, mode=mode) as (one, robot):
        one.daemon.moving = True
        await one.daemon.further(120)
        status = await one.rests()
    assert status["state"] == "running"
    assert status["delay"] > 0
    assert sum(tick.rebased for tick in one.daemon.ticks) > 3
    assert one.daemon.changes == ["ready"]
    assert check_setpoints(tmp_path / "krc.csv", robot)[1] > 0
    assert one.daemon.ticks[-1].setpoint[0] - one.daemon.ticks[0].setpoint[0] > 20 * STEP[0]


@pytest.mark.daily(1)
@pytest.mark.parametrize(("hold", "aspos"), [(0, "moves"), (1, "stands")])
@pytest.mark.parametrize(("mode", "krc_mode"), [("absolute", "relative"), ("relative", "absolute")])
async def test_a_krc_of_the_other_mode_is_named_and_stays_where_it_is(tmp_path, mode, krc_mode, hold, aspos):
    """The cell names a correct file; the file on the KRC has any HOLDON."""
    own = krc_file(SEND, SIX, hold=int(mode == "absolute"))
    (tmp_path / "other.xml").write_text(krc_file(SEND, SIX, hold=hold))
    other = ("--config", tmp_path / "other.xml", "--aspos", aspos)
    async with station(tmp_path, *other, mode=mode, krc_mode=krc_mode, file=own, becomes="faulted") as (
        one,
        robot,
    ):
        (change,) = (event for event in one.daemon.events if isinstance(event, LinkChange))
        assert f"RSI_ON(#{krc_mode.upper()})" in change.reason
        one.daemon.moving = True
        await one.daemon.further(20)
        one.link.close()  # without replies, HOLDON decides whether the KRC keeps the last one
        await one.krc.until(lambda status: status["delay"] > 20)
    with (tmp_path / "krc.csv").open() as trace:
        rows = [[float(value) for value in list(row)[3:]] for row in list(csv.reader(trace))[1:]]
    farthest = probe_size(setup_of(build_cell(load_config([tmp_path / "cell.yaml"])), robot)).farthest
    for axis, far in zip(zip(*rows, strict=True), farthest, strict=True):
        assert max(abs(one - axis[0]) for one in axis) <= 2.0 * math.degrees(far)
        assert abs(axis[-1] - axis[0]) < 1e-6


async def test_an_address_in_use_is_reported_when_the_link_is_opened(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        listen = f'"127.0.0.1:{own.getsockname()[1]}"'
        cell = build_cell(load_config([cell_text(tmp_path, listen=listen)]))
        with pytest.raises(OSError, match=r"in use; expected .*127\.0\.0\.1"):
            await RsiUdpLink(setup_of(cell, cell.robots[0]), "d1").open(lambda event: None)
