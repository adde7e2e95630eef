"""Lock-step in an event loop: the timer of the grace, and steps that follow one another at the end."""

import asyncio
import io

import pytest

from armgate.daemon.pace.lockstep import LockstepPace
from armgate.links.log import Log
from armgate.protocol import messages as m
from support.cells import arms_config
from support.clients import until
from support.peers import Bench, Peer


class Receiver:
    """Receiver of ticks, which counts the steps."""

    def __init__(self, bench):
        self.bench = bench
        self.steps = 0

    def due(self, time, robots, step):
        self.steps += 1
        self.bench.due(time, robots, step)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return arms_config(tmp_path_factory.mktemp("arms"))


def started(config, grace, wall):
    """Return a pace after its start, its receiver and its only participant."""
    periods = [robot.period for robot in config.robots.values()]
    pace = LockstepPace(periods, ("a",), grace, Log(io.StringIO()), wall)
    bench = Bench(config, lockstep=True, now=pace.now)
    receiver = Receiver(bench)
    pace.start(bench.core, receiver)
    peer = Peer(pace.session_id("a", 7), "a")
    pace.steps.join(peer)
    return pace, receiver, peer


async def test_steps_follow_one_another_from_the_last_stop_until_the_close(config):
    pace, receiver, _ = started(config, 1000.0, lambda: 0.0)
    for _ in range(3):
        await asyncio.sleep(0)
    assert receiver.steps == 1
    pace.let_rest(decide=True)
    pace.let_rest(decide=True)
    await until(lambda: receiver.steps == 5)
    assert pace.now() == pytest.approx(4 * 0.012)
    pace.close()
    for _ in range(3):
        await asyncio.sleep(0)
    assert receiver.steps == 5


async def test_the_timer_drops_a_participant_that_sends_nothing(config):
    wall = [0.0]
    pace, _, peer = started(config, 1e-3, lambda: wall[0])
    assert not pace.failed
    wall[0] = 1.0
    await until(lambda: peer.ended)
    pace.close()
    assert pace.failed
    assert peer.take(m.Error)[0].code == "silent"
