"""Tests of the real-time run of a virtual KRC: times of the cycles, slips, and ages of datagrams."""

import asyncio
import select
import socket

import pytest

from armgate.emulator.krc import Context, KrcError
from armgate.emulator.krc.process.network import Channel, Disturbance
from armgate.emulator.krc.process.real_time import RealTimeRunner
from armgate.emulator.krc.process.udp_socket import Peer, UdpSocket
from support.clients import PATIENCE
from support.krcs import ControllerRig, ipoc_of, sen

CYCLE = 4_000_000


class RecordingTimer:
    """Substitute for a kernel timer that records the deadlines."""

    def __init__(self):
        self.armed = []

    def arm(self, deadline):
        self.armed.append(deadline)

    def expired(self):
        return True


@pytest.fixture
def pc():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.setblocking(False)
        yield own


@pytest.fixture
def port(pc):
    krc = UdpSocket(Peer.resolve("127.0.0.1", pc.getsockname()[1]))
    yield krc
    krc.close()


def runner_for(pc, rig, now):
    peer = Peer.resolve("127.0.0.1", pc.getsockname()[1])
    channels = {name: Channel(name, Disturbance()) for name in ("to_pc", "to_krc")}
    return RealTimeRunner(rig.controller, 0.004, peer, log=rig.controller._log, now=now, **channels)


async def received(pc):
    async with asyncio.timeout(PATIENCE):
        return await asyncio.get_running_loop().sock_recvfrom(pc, 65536)


async def test_cycles_have_absolute_times_and_slip_only_if_the_process_is_late(pc):
    time = [0]
    runner = runner_for(pc, ControllerRig(start=False), lambda: time[0])
    runner._cycle_timer = RecordingTimer()
    for now in (0, CYCLE + CYCLE // 20, 2 * CYCLE, 3 * CYCLE + CYCLE // 2, 4 * CYCLE + CYCLE // 2):
        time[0] = now
        runner._on_cycle()
    assert runner._cycle_timer.armed == [
        CYCLE,
        2 * CYCLE,
        3 * CYCLE,
        4 * CYCLE + CYCLE // 2,
        5 * CYCLE + CYCLE // 2,
    ]
    assert runner.slips == 1
    runner._socket.close()


async def age_of_a_reply_read_late(pc, port, after):
    """Send a reply, read it some seconds later, and return its age, ns."""
    pc.sendto(b"reply", ("127.0.0.1", port.port))
    assert select.select([port._socket], [], [], PATIENCE)[0]
    await asyncio.sleep(after)  # this time is part of the measured age
    ((datagram, age),) = port.receive()
    assert (datagram.data, datagram.stranger) == (b"reply", None)
    return age


async def test_the_age_of_a_reply_is_from_the_kernel(pc, port):
    # Linux begins to stamp datagrams a moment after a first socket asks for stamps. Datagrams that arrive
    # before get their stamp when they are read.
    age = attempts = 0
    while age < 20_000_000 and attempts < 100:
        age, attempts = await age_of_a_reply_read_late(pc, port, 0.02), attempts + 1
    assert age >= 20_000_000


async def test_datagrams_of_other_senders_are_marked(pc, port):
    port.send(b"telegram")
    data, source = await received(pc)
    assert (data, source[1]) == (b"telegram", port.port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        stranger.sendto(b"x" * 65_000, source)
        assert select.select([port._socket], [], [], PATIENCE)[0]
        ((datagram, _),) = port.receive()
        assert len(datagram.data) == 65_000
        assert datagram.stranger == f"127.0.0.1:{stranger.getsockname()[1]}"


async def test_the_runner_runs_until_it_is_closed(pc):
    rig = ControllerRig(context=Context(timeout=10**6), start=False)
    rig.operate("start")
    peer = Peer.resolve("127.0.0.1", pc.getsockname()[1])
    channels = {name: Channel(name, Disturbance(delay=0.001)) for name in ("to_pc", "to_krc")}
    runner = RealTimeRunner(rig.controller, 0.004, peer, log=rig.controller._log, **channels)
    runner.start()
    for _ in range(20):
        telegram, source = await received(pc)
        pc.sendto(sen(ipoc_of(telegram)), source)
        if rig.state == "running":
            break
    runner.close()
    assert rig.state == "running"
    assert runner.unsent == 0


def test_an_unknown_host_is_refused():
    with pytest.raises(KrcError, match=r"there is no host 'none\.invalid'"):
        Peer.resolve("none.invalid", 1)
