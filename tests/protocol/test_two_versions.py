"""A server speaks two versions at once, and clients of the first notice nothing.

The daemon itself, with a second version that exists in tests alone.
"""

import asyncio
import io

import pytest

from armgate.cell.cell import build_cell
from armgate.client import aio
from armgate.daemon.lifecycle.daemon import Daemon
from armgate.gate import Gate
from armgate.links.log import Log
from armgate.protocol import DIALECTS, Connection, LocalProtocolError, Refusal, Side, encode
from armgate.protocol import messages as m
from support import version2 as two
from support.cells import arms_config
from support.clients import PATIENCE, Raw

STEP = (0.0005, 0.0, 0.0)
STEPS = 40


class Serving:
    """A daemon that speaks these versions."""

    def __init__(self, folder, dialects, **more):
        self.log = Log(io.StringIO())
        config = arms_config(folder, server="{port: 0}", **more)
        self.daemon = Daemon(build_cell(config), Gate, self.log, dialects=dialects)

    async def __aenter__(self):
        port = asyncio.get_running_loop().create_future()
        self.task = asyncio.create_task(self.daemon.run(lambda host, number: port.set_result(number)))
        return await asyncio.wait_for(port, PATIENCE)

    async def __aexit__(self, *_):
        await Raw.close_all()
        self.daemon.end()
        await asyncio.wait_for(self.task, PATIENCE)
        self.log.close()


async def newcomer(port, name, **more):
    """A client of the second version."""
    raw = await Raw.open(port)
    raw.connection = Connection(Side.CLIENT, (DIALECTS[0], two.CLIENT_SIDE))
    raw.send(m.Hello(versions=(1, 2), name=name, **more))
    raw.welcome = await raw.get(m.Welcome)
    return raw


async def test_each_client_commands_its_robot_in_its_own_version(tmp_path):
    async with Serving(tmp_path, two.BOTH, max_age_ticks=1000) as port:
        old, new = await asyncio.gather(sdk_of_version_1(port), both_ways_of_version_2(port))
    assert (old.version, old.versions) == (1, (1, 2))
    assert (new.version, new.client_versions) == (2, (1, 2))


async def sdk_of_version_1(port):
    async with await aio.connect(f"127.0.0.1:{port}", name="old") as cell, await cell.acquire("A") as robot:
        start, ticks = None, robot.ticks()
        async for tick in ticks:
            start = tick.setpoint[0] if start is None else start
            if tick.setpoint[0] > start + 10 * STEP[0]:
                return cell.welcome
            await robot.send(STEP)
    raise AssertionError("it never moved")


async def both_ways_of_version_2(port):
    new = await newcomer(port, "new")
    fence = await new.acquire("B")
    new.send(m.Subscribe(robots=("B",)))
    for seq, make in enumerate((by_steps, by_jog), start=1):
        state = await new.get(two.State)
        at = state.robots[1].setpoint[0]
        new.send(make(robot="B", fence=fence, seq=seq, tick=state.tick))
        assert (await new.get(two.Verdict)).done
        await new.get(two.State, lambda s, at=at: s.robots[1].setpoint[0] > at)
    return new.welcome


def by_steps(**at):
    return two.Command(**at, steps=(STEP,))


def by_jog(**at):
    return two.Jog(**at, joint=0, by=STEP[0])


async def test_what_the_second_version_refuses_is_told_in_it(tmp_path):
    async with Serving(tmp_path, two.BOTH) as port:
        new = await newcomer(port, "new")
        fence = await new.acquire("B")
        new.send(two.Command(robot="B", fence=fence, seq=5, tick=0, steps=(STEP, STEP)))
        error = await new.get(m.Error)
        assert (error.code, error.seq, error.fatal) == ("invalid_message", 5, False)
        old = await Raw.hello(port, "old")
        old.send_bytes(encode(two.Jog(robot="B", fence=fence, seq=1, tick=0, joint=0, by=0.0)))
        assert (await old.get(m.Error)).code == "unknown_type"
        new.send(m.Signal(name="zoom", value=(1.0,), id=3), m.Ping(time=1.0, id=4))
        assert isinstance(await new.next(), m.Pong)  # the signal is answered by nothing


async def transcript(port, name, version):
    """A participant that commands its robot for some steps; every byte that it was sent."""
    raw = await (Raw.hello(port, name) if version == 1 else newcomer(port, name))
    robot = {"one": "A", "two": "B"}[name]
    fence = await raw.acquire(robot)
    raw.send(m.Subscribe())
    for seq in range(1, STEPS + 1):
        state = await raw.get((m.State, two.State), lambda s: s.robot == robot)
        at = {"robot": robot, "fence": fence, "seq": seq, "tick": state.tick}
        raw.send(m.Command(**at, dq=STEP) if version == 1 else two.Command(**at, steps=(STEP,)))
    return raw


async def heard_by_the_old_one(folder, dialects, version):
    """What a client of version 1 is sent beside a partner of that version."""
    clock = "{kind: lockstep, participants: [one, two], grace: 30.0}"
    async with Serving(folder, dialects, clock=clock) as port, asyncio.timeout(PATIENCE):
        old, _ = await asyncio.gather(transcript(port, "one", 1), transcript(port, "two", version))
        return old.welcome, bytes(old.raw)


async def test_a_client_of_version_1_is_sent_the_same_bytes_beside_one_of_version_2(tmp_path):
    alone, before = await heard_by_the_old_one(tmp_path, DIALECTS, 1)
    beside, after = await heard_by_the_old_one(tmp_path, two.BOTH, 2)
    assert beside == alone.model_copy(update={"versions": (1, 2)})
    before, after = before[len(encode(alone)) :], after[len(encode(beside)) :]
    common = min(len(before), len(after))  # where each stopped reading is chance
    assert common > STEPS * 1000
    assert before[:common] == after[:common]


# --- without a network ------------------------------------------------------------------------------------


def pair(client, server):
    """Both sides of a connection after the welcome."""
    there, here = Connection(Side.CLIENT, client), Connection(Side.SERVER, server)
    (hello,) = here.receive(there.send(m.Hello(versions=there.versions, name="c", capabilities=("lights",))))
    limits = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
    welcome = m.Welcome(
        version=here.version, versions=here.versions, client_versions=hello.versions, start="a",
        session="b", name="c", role="observer", limits=limits, capabilities=("doors",),
    )  # fmt: skip
    there.receive(here.send(welcome))
    return there, here


VERDICT = m.Verdict(
    robot="B", seq=1, tick=1, target=2, outcome="admitted", beta=1.0, dq=(0.0,), setpoint=(0.0,)
)


@pytest.mark.parametrize(
    ("client", "server", "spoken"),
    [
        (DIALECTS, two.BOTH, 1),
        ((DIALECTS[0], two.CLIENT_SIDE), DIALECTS, 1),
        ((DIALECTS[0], two.CLIENT_SIDE), two.BOTH, 2),
        ((two.CLIENT_SIDE,), two.BOTH, 2),
    ],
)
def test_the_highest_in_common_is_spoken_by_both(client, server, spoken):
    there, here = pair(client, server)
    assert (there.version, here.version) == (spoken, spoken)
    made_before = encode(VERDICT)
    sent = here.send(VERDICT, made_before)
    assert (sent == made_before) == (spoken == 1)
    (read,) = there.receive(sent)
    assert isinstance(read, m.Verdict if spoken == 1 else two.Verdict)


def test_what_one_version_does_not_know_cannot_be_said_in_it():
    there, here = pair((DIALECTS[0], two.CLIENT_SIDE), DIALECTS)
    with pytest.raises(LocalProtocolError):
        there.send(two.Jog(robot="B", fence=1, seq=1, tick=0, joint=0, by=0.0))
    assert here.send(m.Signaled(name="zoom"))
    _, here = pair((two.CLIENT_SIDE,), two.BOTH)
    assert here.send(m.Signaled(name="zoom")) == b""


def test_no_version_in_common():
    here = Connection(Side.SERVER, DIALECTS)
    (refusal,) = here.receive(
        Connection(Side.CLIENT, (two.CLIENT_SIDE,)).send(m.Hello(versions=(2,), name="c"))
    )
    assert isinstance(refusal, Refusal)
    assert (refusal.fatal, refusal.error.code) == (True, "version")


def test_each_side_learns_what_the_other_is_capable_of():
    there, here = pair(DIALECTS, DIALECTS)
    assert (here.capabilities, there.capabilities) == ({"lights"}, {"doors"})
