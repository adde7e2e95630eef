"""Robots in a robot server: processes that are killed or stall, and the state in which the robots end."""

import asyncio
import json
import os
import re
import signal
import subprocess
from socket import AF_UNIX, SOCK_DGRAM
from socket import socket as Socket

import pytest

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import PATIENCE, Mover, Process, Raw, launch, run
from support.robot_servers import RobotServer, lift_stops, stopped_by_the_gate


@pytest.fixture
def cell(tmp_path):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml(lag=0.03, max_age_ticks=1000))
    return file


@pytest.fixture
def socket(tmp_path):
    return tmp_path / "s"


def serving(cell, socket):
    return Process.serving(cell, "--robot-server", socket)


async def goes_on(daemon):
    """Reset the stops as an operator, then move a robot as a controller."""
    await lift_stops(daemon.port)
    mover = await Mover.start(daemon.port, "A", "again")
    await mover.moves_on()
    await mover.stop()


def resting(state):
    """Return True if both robots are known to rest."""
    return len(state.entries) == 2 and all(
        entry.q == pytest.approx(entry.setpoint, abs=1e-4) and entry.setpoint == entry.stop_end
        for entry in state.entries
    )


async def nothing_moves(daemon):
    """Check that the robots are stopped and at rest, and that none can be acquired."""
    eye = await Raw.hello(daemon.port, "eye")
    eye.send(m.Subscribe())
    state = await eye.get(m.State, resting)
    assert all(entry.stops for entry in state.entries)
    eye.send(m.Acquire(robot="A"))
    assert (await eye.get((m.Lease, m.Error))).type == "error"
    later = await eye.get(m.State, lambda s: s.entries[0].tick > state.entries[0].tick + 20)
    assert later.entries[0].setpoint == state.entries[0].setpoint


@pytest.mark.slow
async def test_daemon_and_robot_server_end_with_the_robots_at_rest(cell, socket):
    async with RobotServer.running(cell, socket=socket) as robots, serving(cell, socket) as daemon:
        assert os.stat(socket).st_mode & 0o777 == 0o600
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(20)
        daemon.signal()
        await mover.ended()
        status, log = await daemon.end()
        assert status == 0
        assert {"end", "stopped", "at_rest"} <= {line["event"] for line in log}
        assert (await robots.logs("daemon.gone"))["resting"] is True
        robots.signal()
        assert await robots.end() == 0
        assert not socket.exists()


async def test_robots_of_a_killed_daemon_rest_and_the_next_one_moves_none_before_a_reset(cell, socket):
    async with RobotServer.running(cell, socket=socket) as robots:
        async with serving(cell, socket) as daemon:
            mover = await Mover.start(daemon.port, "A")
            await mover.moves_on(20)
            daemon.signal(signal.SIGKILL)
            await mover.ended()
            await robots.logs("daemon.gone")
            await robots.logs("at_rest")
        async with serving(cell, socket) as daemon:
            await nothing_moves(daemon)
            await goes_on(daemon)


@pytest.mark.slow
async def test_a_recording_with_a_robot_server_replays_with_the_same_verdicts(cell, socket, tmp_path):
    """This holds for the recording before a kill, and for that of the next daemon, with the reset."""
    async with RobotServer.running(cell, socket=socket) as robots:
        async with Process.serving(cell, "--robot-server", socket, "--record", tmp_path / "one") as daemon:
            mover = await Mover.start(daemon.port, "A")
            await mover.moves_on(30)
            daemon.signal(signal.SIGKILL)
            await mover.ended()
            await robots.logs("daemon.gone")
        async with Process.serving(cell, "--robot-server", socket, "--record", tmp_path / "two") as daemon:
            await goes_on(daemon)
            daemon.signal()
            assert (await daemon.end())[0] == 0
    assert (await run("recover", tmp_path / "one"))[0] == 0
    for name in ("one", "two"):
        status, said, err = await run("replay", tmp_path / name)
        assert (status, err) == (0, ""), said
        assert "bit for bit" in said


@pytest.mark.slow
async def test_metrics_hold_the_lateness_of_ticks(cell, socket):
    cell.write_text(cell.read_text() + "metrics: {port: 0}\n")
    async with RobotServer.running(cell, socket=socket), serving(cell, socket) as daemon:
        async with asyncio.timeout(PATIENCE):
            while (line := json.loads(await daemon.process.stderr.readline()))["event"] != "metrics":
                pass
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(10)
        status, out, err = await run("status", "--port", line["port"])
        await mover.stop()
    assert (status, err) == (0, "")
    assert int(re.search(r"Lateness of ticks when they are processed\n +count (\d+):", out)[1]) > 10
    assert "unread_bytes: 0" in out


@pytest.mark.slow
async def test_a_stalled_daemon_is_disconnected_and_finds_its_robots_stopped(cell, socket):
    async with RobotServer.running(cell, socket=socket) as robots, serving(cell, socket) as daemon:
        mover = await Mover.start(daemon.port, "A")
        eye = await Raw.hello(daemon.port, "eye")
        await mover.moves_on(20)
        daemon.signal(signal.SIGSTOP)
        assert "stalled" in (await robots.logs("daemon.gone"))["reason"]
        await robots.logs("at_rest")
        daemon.signal(signal.SIGCONT)
        reasons = await stopped_by_the_gate(eye, ("A", "B"))
        assert all("robot server" in reason for reason in reasons.values())
        await robots.logs("daemon")
        await mover.stop()
        await nothing_moves(daemon)
        await goes_on(daemon)


@pytest.mark.slow
async def test_a_robot_server_that_is_killed_stops_the_cell_until_it_is_back_and_reset(cell, socket):
    async with RobotServer.running(cell, socket=socket) as robots, serving(cell, socket) as daemon:
        mover = await Mover.start(daemon.port, "A")
        eye = await Raw.hello(daemon.port, "eye")
        await mover.moves_on(20)
        robots.signal(signal.SIGKILL)
        await stopped_by_the_gate(eye, ("A", "B"))
        await robots.end()
        await mover.stop()
        async with RobotServer.running(cell, socket=socket) as back:
            await back.logs("daemon")
            # A new process places its emulated robots at their start: the gate detects and reports the jump.
            await nothing_moves(daemon)
            await goes_on(daemon)


async def test_only_the_robot_of_a_killed_controller_comes_to_rest(cell, socket):
    async with RobotServer.running(cell, socket=socket), serving(cell, socket) as daemon:
        eye = await Raw.hello(daemon.port, "eye")
        eye.send(m.Subscribe(robots=("A",)))
        other = await Mover.start(daemon.port, "B", "other")
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(20)
        mover.task.cancel()
        mover.raw.writer.transport.abort()
        await eye.get(m.State, lambda s: s.entries[0].holder is None and s.entries[0].tick > 0)
        await eye.get(m.State, lambda s: s.entries[0].setpoint == s.entries[0].stop_end)
        await other.moves_on()
        await other.stop()
        again = await Mover.start(daemon.port, "A", "again")  # without any reset
        await again.moves_on()
        await again.stop()


@pytest.mark.slow
async def test_there_is_one_daemon_at_a_time_and_one_robot_server(cell, socket):
    async with RobotServer.running(cell, socket=socket), serving(cell, socket) as daemon:
        mover = await Mover.start(daemon.port, "A")
        status, out, err = await run("serve", cell, "--robot-server", socket, "--port", 0)
        assert (status, out) == (2, "")
        assert "holds the robots: end it first" in err
        status, out, err = await run("robot-server", cell, "--socket", socket)
        assert (status, out) == (2, "")
        assert "another robot server" in err
        await mover.moves_on()
        await mover.stop()


@pytest.mark.slow
async def test_a_missing_robot_server_and_one_of_another_cell_are_errors_with_a_remedy(
    cell, socket, tmp_path
):
    status, _, err = await run("serve", cell, "--robot-server", socket, "--port", 0)
    assert status == 2
    assert f"armgate robot-server CONFIG… --socket {socket}" in err
    status, _, err = await run("serve", cell, "--robot-server", socket, "--lockstep", "a")
    assert status == 2
    assert "lock-step" in err
    other = tmp_path / "other.yaml"
    other.write_text(arms_yaml(lag=0.02))
    async with RobotServer.running(other, socket=socket):
        status, _, err = await run("serve", cell, "--robot-server", socket, "--port", 0)
    assert status == 2
    assert "start both with the same files" in err


def real_time_is_allowed():
    """Return True if a child process may have real-time priority."""
    with subprocess.Popen(["sleep", "60"]) as child:
        try:
            os.sched_setscheduler(child.pid, os.SCHED_RR, os.sched_param(7))
        except PermissionError:
            return False
        finally:
            child.kill()
    return True


async def test_the_robot_server_gets_real_time_priority_or_reports_why_not(cell, socket):
    if real_time_is_allowed():
        async with RobotServer.running(cell, "--priority", 7, socket=socket) as robots:
            pid = robots.process.pid
            assert os.sched_getscheduler(pid) & os.SCHED_RR
            assert os.sched_getparam(pid).sched_priority == 7
    else:
        status, _, err = await run("robot-server", cell, "--socket", socket, "--priority", 7)
        assert status == 2
        assert "have the limit `rtprio` raised" in err


async def test_the_service_manager_is_notified_that_the_robot_server_is_ready_and_alive(
    cell, socket, tmp_path
):
    with Socket(AF_UNIX, SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "manager"))
        manager.setblocking(False)
        env = os.environ | {"NOTIFY_SOCKET": str(tmp_path / "manager"), "WATCHDOG_USEC": "100000"}
        process = await launch("robot-server", str(cell), "--socket", str(socket), env=env)
        loop, said = asyncio.get_running_loop(), []
        async with asyncio.timeout(PATIENCE):
            while len(said) < 4:
                said.append((await loop.sock_recv(manager, 1000)).decode())
        process.terminate()
        await process.communicate()
    assert said == [f"READY=1\nSTATUS=robots at {socket}", *["WATCHDOG=1"] * 3]
    assert process.returncode == 0
