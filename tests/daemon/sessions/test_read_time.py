"""Read time: leases expire only after all messages that arrived in time were read, even after a stall."""

import asyncio
import itertools
import os
import signal

import pytest

from armgate.daemon.sessions.read_time import ReadTime
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import Process, Raw, until


async def test_the_read_time_advances_after_the_sockets_were_polled_and_no_work_waits():
    now, waiting = 1.0, True
    read_time = ReadTime(lambda: now, lambda: 3, lambda number: waiting)
    assert read_time() == float("-inf")
    now = 5.0
    for _ in range(10):
        await asyncio.sleep(0)
        assert read_time() == float("-inf")
    waiting = False
    await until(lambda: read_time() == 1.0)
    await until(lambda: read_time() == 5.0)


async def test_the_read_time_advances_even_if_newer_work_always_waits():
    """Holders that send without a pause keep their lane from ever being empty."""
    turns = FairScheduler(itertools.count().__next__)  # each piece of work takes a whole turn

    def again(name):
        turns.run_later(name, True, lambda: again(name))

    for name in "abc":
        again(name)
    read_time = ReadTime(lambda: 1.0, turns.privileged_queued, turns.privileged_wait)
    await until(lambda: read_time() == 1.0, turns=100)
    assert turns.privileged_wait(turns.privileged_queued())


async def test_data_in_a_socket_are_read_before_the_read_time_advances():
    """A stall of the process: the event loop finds data and a timer at once."""
    server_read = []
    here, there = os.pipe()
    loop = asyncio.get_running_loop()
    loop.add_reader(here, lambda: server_read.append(os.read(here, 100)))
    read_time = ReadTime(lambda: 7.0, lambda: 0, lambda number: False)
    read_time()
    os.write(there, b"ping")
    await until(lambda: read_time() == 7.0)
    assert server_read == [b"ping"]
    loop.remove_reader(here)
    os.close(here)
    os.close(there)


@pytest.mark.slow
async def test_a_holder_that_pings_keeps_its_lease_over_a_stall_of_the_daemon(tmp_path):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server="{lease_ttl: 0.4}"))
    async with Process.serving(config) as daemon:
        holder, watcher = await Raw.hello(daemon.port, "holder"), await Raw.hello(daemon.port, "watcher")
        fence = await holder.acquire("A")
        for _ in range(2):
            daemon.signal(signal.SIGSTOP)
            for _ in range(16):
                await asyncio.sleep(0.05)
                holder.send(m.Ping(time=0.0))
            daemon.signal(signal.SIGCONT)
            holder.send(m.Ping(time=0.0))
            await asyncio.sleep(0.1)
        holder.send(m.Release(id=1, robot="A", fence=fence))
        answer = await holder.get((m.Lease, m.Error))
        assert (answer.type, getattr(answer, "state", None)) == ("lease", "released"), answer
        fence = await holder.acquire("A")
        lost = await holder.get(m.Lease)  # no further message
        assert lost.state == "lost"
        await watcher.acquire("A")
