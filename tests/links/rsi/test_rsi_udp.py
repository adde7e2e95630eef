"""The RSI link over UDP against `armgate krc` as a process of its own, by the wall clock.

A busy machine is late now and then: the link holds, starts again from rest, and goes on. What a fault
leads to in which cycle is tested with injected time; here it is only waited for.
"""

import asyncio
import contextlib
import json
import math
import socket
import sys

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.events import LinkChange, Plan, PlanKey, Rebase, Tick
from armgate.links.rsi import RsiDrivenLink, setup_of
from support.clients import PATIENCE
from support.rsi import cell_text

STEP = (4e-4, -2e-4, 2e-4, 0.0, 0.0, 0.0)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        return own.getsockname()[1]


class Holder:
    """Whoever holds the link: offers a plan at each tick while ``moving``."""

    def __init__(self, link):
        self.link, self.events, self.news = link, [], asyncio.Event()
        self.moving, self.resets = False, 0

    def __call__(self, event):
        self.events.append(event)
        self.news.set()
        if self.moving and isinstance(event, Tick):
            key = PlanKey("d1", self.resets, event.tick + 1, event.index)
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

    async def rearm(self):
        self.resets += 1
        count = self.changes.count("ready")
        self.link.rebase(Rebase("R", self.ticks[-1].q, self.resets))
        await self.until(lambda: self.changes.count("ready") > count)


class Station:
    """The link and the process."""

    def __init__(self, process, link, holder):
        self.process, self.link, self.holder = process, link, holder

    async def tell(self, line):
        self.process.stdin.write(f"{line}\n".encode())
        async with asyncio.timeout(PATIENCE):
            answer = json.loads((await self.process.stdout.readline()).decode())
        assert answer["ok"], answer
        return answer

    async def rests(self):
        """Nothing is commanded; the status once the KRC stands where the link believes it to be."""
        self.holder.moving = False
        async with asyncio.timeout(PATIENCE):
            while True:
                await self.holder.further(5)
                status, tick = await self.tell("status"), self.holder.ticks[-1]
                shown = map(math.degrees, tick.setpoint)
                gaps = [abs(a - b) for a, b in zip(shown, status["setpoint"].values(), strict=True)]
                if max(gaps) < 2e-6 and not self.link.remaining:
                    return status


@contextlib.asynccontextmanager
async def station(folder, *options, **link):
    given = {"krc": "127.0.0.1", "timeout": 10**6, "late_in_a_row": 10**6, "silence": "1 s", **link}
    port = free_port()
    file = cell_text(folder, cycle=0.012, listen=f'"127.0.0.1:{port}"', **given)
    cell = build_cell(load_config([file]))
    driven = RsiDrivenLink(setup_of(cell, cell.robots[0]), "d1")
    holder = Holder(driven)
    await driven.open(holder)
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "armgate.apps", "krc", "--profile", "krc4-rsi3", "--cycle", "12",
        "--config", str(folder / "krc.xml"), "--to", f"127.0.0.1:{port}", "--cell", str(file), "--robot", "R",
        "--timeout", "1000000", "--axiscorr", "400", "--axiscorrmon", "401", "--precision", "6",
        "--mode", given.get("mode", "absolute"), *options,
        stdin=pipe, stdout=pipe, stderr=asyncio.subprocess.DEVNULL,
    )  # fmt: skip
    try:
        async with asyncio.timeout(PATIENCE):
            await process.stdout.readline()
        await holder.until(lambda: "ready" in holder.changes)
        yield Station(process, driven, holder)
    finally:
        driven.close()
        if process.returncode is None:
            process.kill()
        await process.communicate()


@pytest.mark.parametrize("mode", ["absolute", "relative"])
async def test_a_bad_network_holds_the_robot_and_never_faults_a_drive(tmp_path, mode):
    bad = ("--loss", "0.05", "--duplicate", "0.05", "--reorder", "0.05", "--jitter", "6", "--seed", "3")
    async with station(tmp_path, *bad, mode=mode) as one:
        one.holder.moving = True
        await one.holder.further(150)
        status = await one.rests()
    assert status["state"] == "running"
    assert status["delay"] > 0
    assert sum(tick.rebased for tick in one.holder.ticks) > 3
    assert one.holder.changes == ["ready"]
    assert one.holder.ticks[-1].setpoint[0] - one.holder.ticks[0].setpoint[0] > 20 * STEP[0]


async def test_the_cable_out_on_the_way_to_the_pc_and_in_again(tmp_path):
    async with station(tmp_path) as one:
        one.holder.moving = True
        await one.holder.further(20)
        await one.tell("cable out to-pc")
        await one.holder.until(lambda: one.holder.changes == ["ready", "lost"])
        held = (await one.tell("status"))["setpoint"]
        await one.tell("cable in to-pc")
        await one.holder.further(20)
        assert (await one.tell("status"))["setpoint"] == held
        await one.holder.rearm()
        await one.holder.further(20)
        moved = await one.rests()
    assert moved["setpoint"]["A1"] > held["A1"]


async def test_the_cable_out_on_the_way_to_the_krc_faults_the_link(tmp_path):
    async with station(tmp_path, late_in_a_row=30) as one:
        one.holder.moving = True
        await one.holder.further(20)
        await one.tell("cable out to-krc")
        await one.holder.until(lambda: one.holder.changes == ["ready", "faulted"])
        held = (await one.tell("cable in to-krc"))["setpoint"]
        await one.holder.further(20)
        status = await one.rests()
        assert (status["state"], status["setpoint"]) == ("running", held)
        await one.holder.rearm()


@pytest.mark.parametrize("how", ["restart", "estop"])
async def test_the_krc_begins_anew_while_moving(tmp_path, how):
    async with station(tmp_path) as one:
        one.holder.moving = True
        await one.holder.further(20)
        await one.tell(how)
        await one.holder.until(lambda: one.holder.changes == ["ready", "lost"])
        if how == "estop":
            await one.tell("reset")
            await one.tell("start")
        await one.holder.further(20)
        status = await one.tell("status")
        assert (status["state"], status["setpoint"]) == ("running", status["programmed"])
        await one.holder.rearm()
        await one.holder.further(20)
        moved = await one.rests()
    assert moved["setpoint"]["A1"] > moved["programmed"]["A1"]


async def test_an_address_in_use_is_told_when_it_opens(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        listen = f'"127.0.0.1:{own.getsockname()[1]}"'
        cell = build_cell(load_config([cell_text(tmp_path, listen=listen)]))
        with pytest.raises(OSError, match="in use"):
            await RsiDrivenLink(setup_of(cell, cell.robots[0]), "d1").open(lambda event: None)
