"""A server that supports two versions at once: clients of version 1 receive the same bytes as before.

The tests run the daemon, with a second version that exists only in tests.
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
    """Daemon that supports these versions."""

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


async def client_of_version_2(port, name, **more):
    """Return a client of version 2."""
    raw = await Raw.open(port)
    raw.connection = Connection(Side.CLIENT, (DIALECTS[0], two.CLIENT_SIDE))
    raw.send(m.Hello(versions=(1, 2), name=name, **more))
    raw.welcome = await raw.get(m.Welcome)
    return raw


async def test_each_client_commands_its_robot_in_its_own_version(tmp_path):
    async with Serving(tmp_path, two.BOTH, max_age_ticks=1000) as port:
        old, new = await asyncio.gather(drive_by_the_sdk(port), drive_by_both_commands_of_version_2(port))
    assert (old.version, old.versions) == (1, (1, 2))
    assert (new.version, new.client_versions) == (2, (1, 2))


async def drive_by_the_sdk(port):
    async with await aio.connect(f"127.0.0.1:{port}", name="old") as cell, await cell.acquire("A") as robot:
        start, ticks = None, robot.ticks()
        async for tick in ticks:
            start = tick.setpoint[0] if start is None else start
            if tick.setpoint[0] > start + 10 * STEP[0]:
                return cell.welcome
            await robot.send(STEP)
    raise AssertionError("the robot never moved")


async def drive_by_both_commands_of_version_2(port):
    new = await client_of_version_2(port, "new")
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


async def test_a_refusal_by_version_2_is_sent_in_version_2(tmp_path):
    async with Serving(tmp_path, two.BOTH) as port:
        new = await client_of_version_2(port, "new")
        fence = await new.acquire("B")
        new.send(two.Command(robot="B", fence=fence, seq=5, tick=0, steps=(STEP, STEP)))
        error = await new.get(m.Error)
        assert (error.code, error.seq, error.fatal) == ("invalid_message", 5, False)
        old = await Raw.hello(port, "old")
        old.send_bytes(encode(two.Jog(robot="B", fence=fence, seq=1, tick=0, joint=0, by=0.0)))
        assert (await old.get(m.Error)).code == "unknown_type"
        new.send(m.Signal(name="zoom", value=(1.0,), id=3), m.Ping(time=1.0, id=4))
        assert isinstance(await new.next(), m.Pong)  # version 2 has no answer to a signal


async def transcript(port, name, version):
    """Return a participant that has commanded its robot for some steps, with all bytes that it received."""
    raw = await (Raw.hello(port, name) if version == 1 else client_of_version_2(port, name))
    robot = {"one": "A", "two": "B"}[name]
    fence = await raw.acquire(robot)
    raw.send(m.Subscribe())
    for seq in range(1, STEPS + 1):
        state = await raw.get((m.State, two.State), lambda s: s.robot == robot)
        at = {"robot": robot, "fence": fence, "seq": seq, "tick": state.tick}
        raw.send(m.Command(**at, dq=STEP) if version == 1 else two.Command(**at, steps=(STEP,)))
    return raw


async def received_by_version_1(folder, dialects, version):
    """Return the welcome and the bytes that a client of version 1 receives beside a client of ``version``."""
    clock = "{kind: lockstep, participants: [one, two], grace: 30.0}"
    async with Serving(folder, dialects, clock=clock) as port, asyncio.timeout(PATIENCE):
        old, _ = await asyncio.gather(transcript(port, "one", 1), transcript(port, "two", version))
        return old.welcome, bytes(old.raw)


async def test_a_client_of_version_1_receives_the_same_bytes_beside_a_client_of_version_2(tmp_path):
    alone, before = await received_by_version_1(tmp_path, DIALECTS, 1)
    beside, after = await received_by_version_1(tmp_path, two.BOTH, 2)
    assert beside == alone.model_copy(update={"versions": (1, 2)})
    before, after = before[len(encode(alone)) :], after[len(encode(beside)) :]
    common = min(len(before), len(after))  # each run stops reading at an arbitrary byte
    assert common > STEPS * 1000
    assert before[:common] == after[:common]


# --- without a network ------------------------------------------------------------------------------------


def pair(client, server):
    """Return both sides of a connection after the welcome."""
    client_end, server_end = Connection(Side.CLIENT, client), Connection(Side.SERVER, server)
    (hello,) = server_end.receive(
        client_end.send(m.Hello(versions=client_end.versions, name="c", capabilities=("lights",)))
    )
    limits = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
    welcome = m.Welcome(
        version=server_end.version, versions=server_end.versions, client_versions=hello.versions, start="a",
        session="b", name="c", role="observer", limits=limits, capabilities=("doors",),
    )  # fmt: skip
    client_end.receive(server_end.send(welcome))
    return client_end, server_end


VERDICT = m.Verdict(
    robot="B", seq=1, tick=1, target=2, outcome="admitted", beta=1.0, dq=(0.0,), setpoint=(0.0,)
)


@pytest.mark.parametrize(
    ("client", "server", "chosen"),
    [
        (DIALECTS, two.BOTH, 1),
        ((DIALECTS[0], two.CLIENT_SIDE), DIALECTS, 1),
        ((DIALECTS[0], two.CLIENT_SIDE), two.BOTH, 2),
        ((two.CLIENT_SIDE,), two.BOTH, 2),
    ],
)
def test_both_sides_use_the_highest_version_in_common(client, server, chosen):
    client_end, server_end = pair(client, server)
    assert (client_end.version, server_end.version) == (chosen, chosen)
    made_before = encode(VERDICT)
    sent = server_end.send(VERDICT, made_before)
    assert (sent == made_before) == (chosen == 1)
    (read,) = client_end.receive(sent)
    assert isinstance(read, m.Verdict if chosen == 1 else two.Verdict)


def test_a_message_that_a_version_lacks_cannot_be_sent_in_it():
    client_end, server_end = pair((DIALECTS[0], two.CLIENT_SIDE), DIALECTS)
    with pytest.raises(LocalProtocolError):
        client_end.send(two.Jog(robot="B", fence=1, seq=1, tick=0, joint=0, by=0.0))
    assert server_end.send(m.Signaled(name="zoom"))
    _, server_end = pair((two.CLIENT_SIDE,), two.BOTH)
    assert server_end.send(m.Signaled(name="zoom")) == b""


def test_no_version_in_common_is_fatal():
    server_end = Connection(Side.SERVER, DIALECTS)
    (refusal,) = server_end.receive(
        Connection(Side.CLIENT, (two.CLIENT_SIDE,)).send(m.Hello(versions=(2,), name="c"))
    )
    assert isinstance(refusal, Refusal)
    assert (refusal.fatal, refusal.error.code) == (True, "version")


def test_each_side_receives_the_capabilities_of_the_other():
    client_end, server_end = pair(DIALECTS, DIALECTS)
    assert (server_end.capabilities, client_end.capabilities) == ({"lights"}, {"doors"})
