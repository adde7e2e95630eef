"""A daemon that leaves ticks unread, and a robot server with a KRC: real sockets, injected time."""

import asyncio
import socket
from dataclasses import replace
from random import Random

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.emulator.krc import PROFILES, Arrival, Context, Controller, Event, EventLog, read_ethernet
from armgate.emulator.krc.robot.arm import kr16
from armgate.events import Plan, PlanAnswer, PlanKey
from armgate.links.robot_server.codec import Decoder, encode
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.robot_server.messages import FORMAT, Heartbeat, Hello, ResumePoint, TickReport, Welcome
from armgate.links.robot_server.server import RobotServer
from armgate.links.robot_server.unix_socket import listen
from armgate.links.rsi.setup import setup_of
from armgate.links.rsi.udp_link import RsiUdpLink
from support.clients import PATIENCE
from support.krcs import LogRecords
from support.rsi import WIDE, cell_text

PERIOD = 0.004
STEP = 1e-5


class Log(list):
    """Events by name."""

    def info(self, event, **fields):
        self.append((event, fields))

    warning = info

    def of(self, name):
        return [fields for event, fields in self if event == name]


class Daemon:
    """Daemon that sends messages, and reads only if a test calls `get`."""

    def __init__(self, rig):
        self.socket = rig.opened(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(str(rig.path))
        self.decoder, self.messages = Decoder(), []

    @classmethod
    async def welcomed(cls, rig, start):
        daemon = cls(rig)
        await daemon.send(Hello(FORMAT, rig.cell.hash, start, (ResumePoint("R", 0, 0),)))
        await daemon.get(Welcome)
        return daemon

    async def send(self, message):
        await asyncio.get_running_loop().sock_sendall(self.socket, encode(message))

    async def get(self, kind):
        """Return the next message of a kind."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(PATIENCE):
            while True:
                while self.messages:
                    if isinstance(message := self.messages.pop(0), kind):
                        return message
                self.messages += self.decoder.push(await loop.sock_recv(self.socket, 65536))


class Rig:
    """A robot server with one RSI link, and its KRC."""

    def __init__(self, folder):
        self.time = 100.0
        self.cell = build_cell(load_config([cell_text(folder, krc="127.0.0.1", listen="127.0.0.1:1")]))
        setup = replace(setup_of(self.cell, self.cell.robots[0]), listen=("127.0.0.1", 0))
        self.link = RsiUdpLink(setup, "s", now=lambda: self.time)
        self.log, self.path = Log(), folder / "s"
        self.server = RobotServer(
            self.cell.hash, [HostedLink(self.link, "s", 1e-6, 0.02)], self.log, lambda: self.time
        )
        self.krc = Controller(
            PROFILES["krc4-rsi3"], Context(precision=6, limits=WIDE, monitor=WIDE),
            read_ethernet((folder / "krc.xml").read_bytes()),
            kr16().starting((0.0, -90.0, 90.0, 0.0, 45.0, 0.0)), chance=Random(1), log=EventLog(LogRecords()),
        )  # fmt: skip
        self.krc.operate(Event.START)
        self.sockets = []
        self.socket = self.opened(socket.AF_INET, socket.SOCK_DGRAM)
        self.waiting = []

    def opened(self, family, kind):
        """Return a socket that is closed at the end."""
        self.sockets.append(socket.socket(family, kind))
        self.sockets[-1].setblocking(False)
        return self.sockets[-1]

    async def cycle(self):
        """Run one cycle of the KRC, with its reply."""
        telegram, loop = self.krc.cycle(self.waiting), asyncio.get_running_loop()
        self.time += PERIOD
        await loop.sock_sendto(self.socket, telegram, ("127.0.0.1", self.link.port))
        reply = await asyncio.wait_for(loop.sock_recv(self.socket, 4096), PATIENCE)
        self.waiting = [Arrival(reply, 0.001, None)]


@pytest.fixture
async def rig(tmp_path):
    one = Rig(tmp_path)
    listening, lock = listen(one.path)
    up = asyncio.Event()
    with lock, listening:
        task = asyncio.create_task(one.server.run(listening, up.set))
        await up.wait()
        yield one
        one.server.end()
        one.server.end()
        await task
    for own in one.sockets:
        own.close()


async def test_the_connection_is_closed_and_the_plan_is_played_to_its_end_while_the_krc_is_answered(rig):
    daemon = await Daemon.welcomed(rig, "d1")
    for _ in range(600):
        await rig.cycle()
        if rig.link.core.state.value == "ready":
            break
    while (last := await daemon.get(TickReport)).event.time < rig.time:
        pass
    increments = ((STEP, 0.0, 0.0, 0.0, 0.0, 0.0),) * 5000
    await daemon.send(Plan("R", PlanKey("d1", 0, last.event.tick + 1, -1), 1, increments))
    assert (await daemon.get(PlanAnswer)).accepted
    cycles = 0
    while not rig.log.of("daemon.gone"):
        await rig.cycle()
        cycles += 1
        if cycles % 50 == 0:
            await daemon.send(Heartbeat())  # it sends, but does not read
    assert "bytes are unread" in rig.log.of("daemon.gone")[0]["reason"]
    assert 0 < rig.link.remaining < 5000
    while rig.link.remaining:
        await rig.cycle()
    await rig.cycle()
    status = rig.krc.status()
    assert (status["state"], status["delay"]) == ("running", 0)
    assert status["setpoint"]["A1"] == pytest.approx(5000 * STEP * 57.29577951308232, abs=1e-5)
    await Daemon.welcomed(rig, "d2")
