"""``armgate serve`` as a process: its start, its end, and its repeatability in lock-step."""

import asyncio
import signal
import socket
import sys

import pytest

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import PATIENCE, Mover, Process, Raw, launch, run


def config(tmp_path, **options):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml(**options))
    return file


# --- starting ---------------------------------------------------------------------------------------------


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("stop_distance: 20 mm", "stop_distance: 20 mm/h", ["arms.yaml:3", "stop_distance"]),
        ("armgate: 1", "armgate: 1\nrobot: {}", ["arms.yaml:2", "robot"]),
        ("robots:", "robots: [", ["arms.yaml"]),
        ("planar3.urdf", "planar4.urdf", ["arms.yaml:7", "planar4.urdf"]),
    ],
)
async def test_a_malformed_configuration_is_named_with_file_and_line(tmp_path, old, new, said):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml().replace(old, new, 1))
    for command in ("serve", "check"):
        status, out, err = await run(command, file)
        assert status == 2
        assert out == ""
        assert all(part in err for part in said), err
        assert "Traceback" not in err


async def test_a_missing_file_is_a_usage_error(tmp_path):
    status, _, err = await run("serve", tmp_path / "none.yaml")
    assert status == 2
    assert "none.yaml" in err


@pytest.mark.slow
async def test_a_port_in_use_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        status, out, err = await run("serve", config(tmp_path), "--port", port)
    assert (status, out) == (2, "")
    assert f"127.0.0.1:{port}" in err
    assert "in use" in err
    assert "Traceback" not in err


@pytest.mark.daily(1)
@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.7.5", "cell.example"])
async def test_listening_beyond_this_machine_is_refused_with_the_reason(tmp_path, host):
    status, out, err = await run("serve", config(tmp_path), "--host", host)
    assert (status, out) == (2, "")
    assert host in err
    assert "TLS" in err
    assert "server.tls and server.tokens" in err


async def test_invalid_names_of_participants_are_usage_errors(tmp_path):
    status, _, err = await run("serve", config(tmp_path), "--lockstep", "a,,b")
    assert status == 2
    assert "--lockstep" in err


# --- ending -----------------------------------------------------------------------------------------------


@pytest.mark.daily(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_a_signal_while_robots_move_lets_them_rest_first(tmp_path, number):
    async with Process.serving(config(tmp_path, lag=0.03, max_age_ticks=1000)) as daemon:
        mover = await Mover.start(daemon.port, "A")
        eye = await Raw.hello(daemon.port, "eye", "observer")
        eye.send(m.Subscribe())
        await mover.moves_on(20)
        daemon.signal(number)
        told = await eye.rest()
        await mover.stop()
        await Raw.close_all()
        status, log = await daemon.end()
    assert status == 0
    states = [x for x in told if isinstance(x, m.State)]
    stopped = next(x for x in told if isinstance(x, m.Stopped))
    assert (stopped.by, stopped.robots) == ("daemon", ("A", "B"))
    for entry in states[-1].entries:
        assert entry.q == pytest.approx(entry.setpoint, abs=1e-3)
        assert entry.setpoint == entry.stop_end
    assert isinstance(told[-1], m.Bye)
    assert {"listening", "welcome", "end", "stopped", "at_rest"} <= {line["event"] for line in log}


async def test_a_client_that_is_killed_loses_its_robot_and_the_robot_rests(tmp_path):
    async with Process.serving(config(tmp_path, max_age_ticks=1000)) as daemon:
        eye = await Raw.hello(daemon.port, "eye", "observer")
        eye.send(m.Subscribe(robots=("A",)))
        other = await Mover.start(daemon.port, "B", "other")
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(20)
        moving = await eye.get(m.State, lambda s: s.entries[0].holder == "mover")
        mover.task.cancel()
        mover.raw.writer.transport.abort()
        free = await eye.get(m.State, lambda s: s.entries[0].holder is None)
        rest = await eye.get(
            m.State, lambda s: s.entries[0].q == s.entries[0].setpoint == s.entries[0].stop_end
        )
        assert moving.tick < free.tick <= rest.tick
        again = await Raw.hello(daemon.port, "again")
        assert await again.acquire("A") > mover.fence
        await other.moves_on()
        await other.stop()


async def test_a_lease_expires_if_its_client_sends_nothing_although_it_stays_connected(tmp_path):
    async with Process.serving(config(tmp_path, server="{lease_ttl: 0.3}")) as daemon:
        silent = await Raw.hello(daemon.port, "silent")
        fence = await silent.acquire("A")
        lost = await silent.get(m.Lease)
        assert (lost.state, lost.robot, lost.fence) == ("lost", "A", fence)
        silent.send(m.Command(robot="A", fence=fence, seq=1, tick=0, dq=(0.0, 0.0, 0.0)))
        verdict = await silent.get(m.Verdict)
        assert verdict.reasons[0].cause in ("lease", "fence")


# --- lock-step --------------------------------------------------------------------------------------------


async def lockstep_run(file, order):
    """Return the bytes that two controllers and an observer receive in a lock-step run."""
    async with Process.serving(file, "--lockstep", "one,two,eye") as daemon:
        start = {
            "one": lambda: lockstep_controller(daemon.port, "one", "A", 40),
            "two": lambda: lockstep_controller(daemon.port, "two", "B", 40),
            "eye": lambda: lockstep_observer(daemon.port, 40),
        }
        tasks = [asyncio.create_task(start[name]()) for name in order]
        raws = dict(zip(order, await asyncio.wait_for(asyncio.gather(*tasks), PATIENCE), strict=True))
        daemon.signal()
        status, _ = await daemon.end()
        assert status == 0
    return raws


async def lockstep_controller(port, name, robot, steps):
    raw = await Raw.hello(port, name)
    fence = await raw.acquire(robot)
    raw.send(m.Subscribe(robots=(robot,)))
    for step in range(steps):
        state = await raw.get(m.State, lambda s, step=step: s.step == step)
        raw.send(m.Signal(name=f"{name}.step", value=(float(step),)))
        dq = (0.0005 if step < steps / 2 else -0.0005, 0.0, 0.0003)
        raw.send(m.Command(robot=robot, fence=fence, seq=step, tick=state.tick, dq=dq))
    await raw.get(m.State, lambda s: s.step == steps)
    return bytes(raw.raw)


async def lockstep_observer(port, steps):
    raw = await Raw.hello(port, "eye", "observer")
    raw.send(m.Subscribe())
    for step in range(steps):
        await raw.get(m.State, lambda s, step=step: s.step == step and s.robot == "B")
        raw.send(m.Pass(step=step))
    await raw.get(m.State, lambda s: s.step == steps and s.robot == "B")
    return bytes(raw.raw)


@pytest.mark.slow
async def test_two_lockstep_runs_send_the_same_bytes(tmp_path):
    file = config(tmp_path, lag=0.03)
    first = await lockstep_run(file, ["one", "two", "eye"])
    second = await lockstep_run(file, ["eye", "two", "one"])
    assert len(first["eye"]) > 40_000
    assert {name: first[name] == second[name] for name in first} == dict.fromkeys(first, True)


# --- check ------------------------------------------------------------------------------------------------


async def test_check_reports_robots_joints_pairs_and_clearance(tmp_path):
    status, out, _ = await run("check", config(tmp_path))
    assert status == 0
    for part in ("A", "B", "J1", "166.2°", "surroundings", "20 mm", "within all limits"):
        assert part in out


async def test_check_fails_if_the_start_is_too_close(tmp_path):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml().replace("xyz: [0.6, 0.9, 0.5]", "xyz: [0.5, 0.0, 0.5]"))
    status, out, _ = await run("check", file)
    assert status == 1
    assert "post" in out
    assert "the distance to keep is 20 mm" in out


async def test_help_names_the_options():
    process = await launch("serve", "--help")
    out, _ = await process.communicate()
    assert process.returncode == 0
    assert b"--lockstep" in out


@pytest.mark.parametrize("command", ["serve", "check"])
async def test_a_missing_cell_extra_is_reported_with_its_installation(tmp_path, command):
    hidden = (
        "import sys; sys.modules['pinocchio'] = None; from armgate.apps.cli import main; main(sys.argv[1:])"
    )
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", hidden, command, str(config(tmp_path)), stderr=asyncio.subprocess.PIPE
    )
    _, err = await asyncio.wait_for(process.communicate(), PATIENCE)
    assert process.returncode == 2
    assert "pip install '.[cell]'" in err.decode()
