"""The fault matrix through the whole stack: each fault while the robot moves, and the state in which it ends.

Virtual KRC, robot server and daemon are processes that the tests share; a killed one is started again. The
tests of the link check the cycle in which each fault takes effect, with injected time. Here, after each
fault, every setpoint that the drives of the KRC received so far is compared with the robot's bounds.
"""

import signal
import socket

import pytest
import pytest_asyncio

from support.clients import run
from support.rsi_stack import RsiStack

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def stack(tmp_path_factory):
    one = RsiStack(tmp_path_factory.mktemp("rsi"))
    async with one.exits:
        yield one
        await one.leave()


@pytest.mark.slow
async def test_the_robot_of_a_killed_controller_comes_to_rest_and_needs_no_reset(stack):
    mover = await stack.begin()
    mover.task.cancel()
    mover.raw.writer.transport.abort()
    status = await stack.krc.rests()
    assert status["state"] == "running"
    await stack.moves()
    stack.within_bounds()


@pytest.mark.slow
async def test_the_robot_of_a_killed_daemon_rests_and_its_krc_is_still_answered(stack):
    mover = await stack.begin()
    stack.daemon.signal(signal.SIGKILL)
    await mover.ended()
    await stack.daemon.end()
    await stack.robots.logs("daemon.gone")
    await stack.robots.logs("at_rest")
    rests = await stack.krc.rests()
    assert rests["state"] == "running"
    delay = rests["delay"]
    later = await stack.krc.rests(100)
    assert later["setpoint"] == rests["setpoint"]
    assert later["delay"] < delay + 50  # the KRC still gets replies, even on a busy machine
    await stack.serve()
    assert (await stack.krc.rests())["setpoint"] == rests["setpoint"]
    await stack.goes_on()


async def test_a_stalled_daemon_is_disconnected_and_its_robot_rests(stack):
    await stack.begin()
    stack.daemon.signal(signal.SIGSTOP)
    assert "stalled" in (await stack.robots.logs("daemon.gone"))["reason"]
    await stack.robots.logs("at_rest")
    assert (await stack.krc.rests())["state"] == "running"
    stack.daemon.signal(signal.SIGCONT)
    assert "is lost: the robot server" in await stack.stopped()
    await stack.robots.logs("daemon")
    await stack.goes_on()


@pytest.mark.slow
async def test_a_krc_whose_robot_server_is_killed_stops_by_itself(stack):
    await stack.begin()
    stack.robots.signal(signal.SIGKILL)
    assert "KSS29002" in (await stack.krc.breaks_off())["message"]
    assert "is lost: the robot server" in await stack.stopped()
    await stack.robots.end()
    await stack.serve_robots()
    await stack.robots.logs("daemon")
    await stack.krc.starts_anew()
    await stack.goes_on()


@pytest.mark.slow
async def test_a_krc_whose_robot_server_stalls_stops_by_itself(stack):
    await stack.begin()
    stack.robots.signal(signal.SIGSTOP)
    await stack.krc.breaks_off()
    assert "is lost: the robot server: stalled" in await stack.stopped()
    stack.robots.signal(signal.SIGCONT)
    await stack.robots.logs("daemon")
    await stack.krc.starts_anew()
    await stack.goes_on()


async def test_a_robot_server_that_halts_for_some_cycles_plays_no_missed_increment(stack):
    """Telegrams queue up while the robot has a plan: none of them makes the setpoint jump."""
    mover = await stack.begin()
    delay = (await stack.krc.tell("status"))["delay"]
    stack.robots.signal(signal.SIGSTOP)
    await stack.krc.until(lambda s: s["delay"] >= delay + 8)
    await mover.stop()
    stack.robots.signal(signal.SIGCONT)
    assert (await stack.krc.rests())["state"] == "running"
    await stack.leave()
    await stack.lift_stops()  # needed if the halt exceeded the timeout of the link
    await stack.moves()
    stack.within_bounds()


@pytest.mark.slow
async def test_a_krc_that_halts_for_a_moment_stops_with_a_reason_and_needs_a_new_run(stack):
    await stack.begin()
    stack.krc.process.send_signal(signal.SIGSTOP)
    assert "is lost: no telegram for 0.3 s" in await stack.stopped()
    stack.krc.process.send_signal(signal.SIGCONT)
    assert "the KRC holds is not known" in (await stack.robots.logs("link"))["text"]
    await stack.nothing_moves()
    await stack.krc.tell("stop")
    await stack.krc.tell("start")
    await stack.goes_on()


async def test_there_is_one_daemon_at_a_time(stack):
    mover = await stack.begin()
    status, out, err = await run("serve", stack.file, "--robot-server", stack.socket, "--port", 0)
    assert (status, out) == (2, "")
    assert "holds the robots: end it first" in err
    await mover.moves_on(20)
    stack.within_bounds()


async def test_invalid_and_foreign_telegrams_change_nothing(stack):
    mover = await stack.begin()
    bomb = b'<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><Rob><IPOC>&c;</IPOC></Rob>'
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        for data in (b"x" * 65507, b"", bomb, b"<Rob><IPOC>1</IPOC></Rob>") * 10:
            other.sendto(data, ("127.0.0.1", stack.port))
    await mover.moves_on(20)
    assert (await stack.krc.tell("status"))["state"] == "running"
    stack.within_bounds()


@pytest.mark.slow
@pytest.mark.parametrize(("way", "state"), [("to-pc", "lost"), ("to-krc", "faulted")])
async def test_a_cable_that_is_unplugged_and_plugged_in_again(stack, way, state):
    await stack.begin()
    await stack.krc.tell(f"cable out {way}")
    assert f"is {state}: " in await stack.stopped()
    await stack.krc.tell(f"cable in {way}")
    assert (await stack.krc.tell("status"))["state"] == "running"
    await stack.goes_on()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["restart", "estop", "pause"])
async def test_a_krc_that_restarts(stack, how):
    await stack.begin()
    await stack.krc.tell(how)
    assert "is lost: " in await stack.stopped()
    if how == "estop":
        await stack.krc.tell("reset")
        await stack.krc.tell("jog A1 -5")
        await stack.krc.tell("start")
    if how == "pause":  # the KRC's correction is unknown: it gets no replies before its program restarts
        await stack.krc.tell("stop")
        await stack.krc.tell("start")
    status = await stack.krc.rests()
    assert status["setpoint"] == status["programmed"]
    await stack.goes_on()


@pytest.mark.slow
async def test_an_ipoc_that_jumps(stack):
    await stack.begin()
    await stack.krc.tell("ipoc 5000000001")
    assert "is faulted: the IPOC jumped" in await stack.stopped()
    # The robot was moving: the correction that the KRC holds is unknown, so that it gets no more replies.
    await stack.krc.breaks_off()
    await stack.krc.starts_anew()
    await stack.goes_on()
