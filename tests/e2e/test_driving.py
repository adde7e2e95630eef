"""Driving by hand in real processes: SDL's virtual gamepad and a terminal, against a daemon."""

import asyncio
import contextlib
import os
import pty
import sys
from pathlib import Path

import pytest
import pytest_asyncio

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import PATIENCE, Process, Raw, run

pytestmark = pytest.mark.asyncio(loop_scope="module")

ROOT = Path(__file__).parents[2]
PAD = (sys.executable, "-m", "support.virtual_pad")
ARMGATE = (sys.executable, "-m", "armgate.apps")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def daemon(tmp_path_factory):
    config = tmp_path_factory.mktemp("driving") / "arms.yaml"
    config.write_text(arms_yaml(max_age_ticks=1000))
    async with Process.serving(config) as daemon:
        yield daemon
        daemon.signal()
        assert (await daemon.end())[0] == 0


class Eye:
    """Client in the operator role that receives the states of robot A."""

    def __init__(self, raw):
        self.raw = raw

    @classmethod
    async def open(cls, daemon):
        eye = cls(await Raw.hello(daemon.port, "eye", "operator"))
        eye.raw.send(m.Subscribe())
        return eye

    async def entry(self, where=lambda entry: True):
        """Return robot A in the next of its states that meets the condition."""
        found = []

        def fits(state):
            found[:] = [entry for entry in state.entries if entry.robot == "A"]
            return state.robot == "A" and where(found[0])

        await self.raw.get(m.State, fits)
        return found[0]

    async def moving(self):
        """Wait until the setpoint changes."""
        before = (await self.entry()).setpoint
        await self.entry(lambda entry: entry.setpoint != before)

    async def resting(self):
        """Wait until the setpoint stays the same once the daemon has read what was sent so far; return it."""
        self.raw.send(m.Ping(time=0.0))
        await self.raw.get(m.Pong)
        before = await self.entry()
        while True:
            now = await self.entry()
            if before.setpoint == now.setpoint == pytest.approx(now.stop_end, abs=1e-9):
                return now.setpoint
            before = now

    async def free(self):
        await self.entry(lambda entry: entry.holder is None)
        return await self.resting()


@pytest_asyncio.fixture(loop_scope="module")
async def eye(daemon):
    eye = await Eye.open(daemon)
    yield eye
    eye.raw.send(m.Bye())
    await eye.raw.rest()


class Leader:
    """``armgate lead`` with a virtual gamepad."""

    def __init__(self, process):
        self.process, self.printed = process, ""

    def do(self, *lines):
        self.process.stdin.write("".join(line + "\n" for line in lines).encode())

    async def prints(self, text):
        """Wait until it has printed this."""
        async with asyncio.timeout(PATIENCE):
            while text not in self.printed:
                line = (await self.process.stdout.readline()).decode()
                assert line, f"it ended: {self.printed}"
                self.printed += line

    async def ends(self):
        """Return its exit status, and everything that it printed."""
        async with asyncio.timeout(PATIENCE):
            out, err = await self.process.communicate()
        return self.process.returncode, self.printed + out.decode() + err.decode()


@contextlib.asynccontextmanager
async def leading(daemon, *arguments, program=(*PAD, "with"), **pipes):
    command = ("lead", f"127.0.0.1:{daemon.port}", "--robot", "A", *arguments)
    more = {"SDL_VIDEODRIVER": "dummy", "PYTHONPATH": str(ROOT / "tests"), "PYTHONUNBUFFERED": "1"}
    pipes = {"stdin": asyncio.subprocess.PIPE} | pipes
    process = await asyncio.create_subprocess_exec(
        *program, *command, cwd=ROOT, env=os.environ | more,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, **pipes,
    )  # fmt: skip
    try:
        yield Leader(process)
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()


def by_pad(daemon, *arguments):
    return leading(daemon, "--input", "gamepad", *arguments)


# --- the gamepad ------------------------------------------------------------------------------------------


async def test_the_robot_moves_while_the_deadman_switch_is_held_and_rests_when_it_is_released(daemon, eye):
    async with by_pad(daemon) as leader:
        await leader.prints("hold the left shoulder")
        start = await eye.resting()
        leader.do("axis LEFTY -1")  # no motion without the deadman switch
        held = await eye.entry(lambda entry: entry.holder == "leader")
        assert held.setpoint == start
        leader.do("button LEFTSHOULDER 1")
        await eye.moving()
        leader.do("button LEFTSHOULDER 0", "button DPAD_UP 1")
        await leader.prints("100% of the speed")  # so it has noticed the release
        there = await eye.resting()
        assert there[0] > start[0]
        assert there[1:] == start[1:]
        leader.do("axis LEFTY 0.1", "button LEFTSHOULDER 1", "button DPAD_RIGHT 1")
        await leader.prints("moving joint J2")
        assert await eye.resting() == there  # inside the dead zone
        leader.do("axis LEFTY 1")
        await eye.moving()
        leader.do("button LEFTSHOULDER 0", "button DPAD_DOWN 1")
        await leader.prints("50% of the speed")
        assert (await eye.resting())[1] < there[1]
        leader.do("button START 1")
        status, said = await leader.ends()
    assert (status, "A: ended by the gamepad, at rest" in said) == (0, True), said


async def test_the_tool_moves_along_the_world(daemon, eye):
    async with by_pad(daemon, "--mode", "tool") as leader:
        await leader.prints("moving the tool")
        start = await eye.resting()
        leader.do("axis LEFTX -1", "button LEFTSHOULDER 1")
        await eye.moving()
        leader.do("button RIGHTSTICK 1")
        await leader.prints("moving joint J1")
        leader.do("button LEFTSHOULDER 0")
        assert await eye.resting() != start
        leader.do("button START 1")
        assert (await leader.ends())[0] == 0


async def test_a_gamepad_unplugged_while_driving_leaves_the_robot_at_rest_and_is_reported(daemon, eye):
    async with by_pad(daemon) as leader:
        await leader.prints("hold the left shoulder")
        leader.do("axis LEFTY -0.5", "button LEFTSHOULDER 1")
        await eye.moving()
        leader.do("pull")
        status, said = await leader.ends()
        await eye.free()
    assert status == 1
    assert "the gamepad was unplugged; it is at rest" in said, said
    assert "Traceback" not in said


async def test_a_deadman_switch_held_from_the_start_moves_no_robot(daemon, eye):
    async with by_pad(daemon) as leader:
        leader.do("axis LEFTY -1", "button LEFTSHOULDER 1")
        await leader.prints("release the left shoulder first")
        first = await eye.entry(lambda entry: entry.holder == "leader")
        assert await eye.resting() == first.setpoint
        leader.do("button LEFTSHOULDER 0")
        await leader.prints("hold the left shoulder")
        leader.do("button LEFTSHOULDER 1")
        await eye.moving()
        leader.do("button START 1")
        assert (await leader.ends())[0] == 0
        await eye.free()


async def test_a_missing_gamepad_is_reported(daemon):
    async with leading(daemon, "--input", "gamepad", program=(*PAD, "none")) as leader:
        status, said = await leader.ends()
    assert status == 1
    assert "no gamepad is plugged in" in said


# --- other failures ---------------------------------------------------------------------------------------


async def test_a_stop_while_driving_ends_the_leader_with_the_reason(daemon, eye):
    async with by_pad(daemon) as leader:
        await leader.prints("hold the left shoulder")
        leader.do("axis LEFTY -1", "button LEFTSHOULDER 1")
        await eye.moving()
        eye.raw.send(m.Stop(robot="A", reason="enough"))
        stopped = await eye.raw.get(m.Stopped)
        status, said = await leader.ends()
    assert status == 1
    assert "stop" in said
    assert "enough" in said
    await eye.free()
    eye.raw.send(m.Reset(stop=stopped.stop))
    await eye.raw.get(m.Resumed)


async def ping(client):
    """Renew the lease of a client until cancelled: the leader may take long to start."""
    while True:
        client.send(m.Ping(time=0.0))
        await asyncio.sleep(0.3)


async def test_a_leader_without_a_lease_moves_no_robot_and_reports_the_reason(daemon, eye):
    other = await Raw.hello(daemon.port, "other")
    await other.acquire("A")
    before = await eye.resting()
    pings = asyncio.create_task(ping(other))
    async with by_pad(daemon) as leader:
        status, said = await leader.ends()
    pings.cancel()
    assert status == 1
    assert "A is held by other" in said
    assert await eye.resting() == before
    other.send(m.Bye())
    await other.rest()


async def test_a_leader_that_loses_its_lease_reports_the_reason(daemon, eye):
    async with by_pad(daemon) as leader:
        await leader.prints("hold the left shoulder")
        leader.do("axis LEFTY -1", "button LEFTSHOULDER 1")
        await eye.moving()
        fence = await eye.raw.acquire("A", takeover=True)
        status, said = await leader.ends()
    assert status == 1
    assert "the lease of A ended" in said
    await eye.resting()
    eye.raw.send(m.Release(robot="A", fence=fence))
    await eye.free()


@pytest.mark.slow
async def test_a_wrong_token_moves_no_robot_and_is_reported(tmp_path):
    file, config = tmp_path / "tokens", tmp_path / "arms.yaml"
    status, _, err = await run("token", "--role", "controller", "--file", file)
    assert status == 0, err
    config.write_text(arms_yaml(server="{tokens: tokens}"))
    async with Process.serving(config) as secured:
        (tmp_path / "wrong").write_text("armgate_wrong\n")
        (tmp_path / "wrong").chmod(0o600)
        async with by_pad(secured, "--token-file", str(tmp_path / "wrong")) as leader:
            status, said = await leader.ends()
    assert status == 1
    assert "unauthorized" in said
    assert "armgate_wrong" not in said


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "expected exactly one of --path FILE, --input NAME and --pursue ROBOT/BODY"),
        (("--input", "wheel"), "no input 'wheel'; there are gamepad, keyboard"),
        (("--input", "keyboard"), "needs a terminal"),
        (("--input", "keyboard", "--robot", "Z"), "has no robot 'Z'; expected one of A, B"),
    ],
)
async def test_wrong_options_are_reported(daemon, arguments, told):
    status, _, err = await run("lead", f"127.0.0.1:{daemon.port}", "--robot", "A", *arguments)
    assert status == 2
    assert told in err


# --- the keyboard -----------------------------------------------------------------------------------------


@contextlib.asynccontextmanager
async def terminal(daemon):
    """A leader in a terminal, and the other end of the terminal."""
    ours, theirs = pty.openpty()
    try:
        async with leading(daemon, "--input", "keyboard", program=ARMGATE, stdin=theirs) as leader:
            os.close(theirs)
            await leader.prints("keyboard: moving joint J1")
            yield leader, ours
    finally:
        with contextlib.suppress(OSError):
            os.close(ours)


async def pressed(eye, ours, key, joint):
    """Press a key repeatedly, as a terminal does while it is held, until the joint has moved."""
    start = (await eye.entry()).setpoint
    while (now := await eye.entry()).setpoint[joint] == start[joint]:
        os.write(ours, key)
    return now.setpoint[joint] - start[joint]


async def test_a_key_moves_the_robot_while_it_repeats(daemon, eye):
    async with terminal(daemon) as (leader, ours):
        await eye.entry(lambda entry: entry.holder == "leader")
        assert await pressed(eye, ours, b"\x1b[A", 0) > 0.0
        await eye.resting()
        os.write(ours, b"2")
        await leader.prints("moving joint J2")
        assert await pressed(eye, ours, b"-", 1) < 0.0
        await eye.resting()
        os.write(ours, b"q")
        status, said = await leader.ends()
    assert (status, "ended by the keyboard, at rest" in said) == (0, True), said


@pytest.mark.slow
async def test_a_closed_terminal_leaves_the_robot_at_rest(daemon, eye):
    async with terminal(daemon) as (leader, ours):
        await eye.entry(lambda entry: entry.holder == "leader")
        await pressed(eye, ours, b"+", 0)
        os.close(ours)
        status, said = await leader.ends()
        await eye.free()
    assert status == 1
    assert "the terminal was closed; it is at rest" in said, said
