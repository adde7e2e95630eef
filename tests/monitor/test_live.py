"""``armgate monitor HOST:PORT CONFIG`` with a real daemon: checks, stops of the cell, and its end."""

import asyncio
import contextlib
import os
import signal

import pytest

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import PATIENCE, Mover, Process, Raw, launch, run


def config(tmp_path, name="arms.yaml", **options):
    file = tmp_path / name
    file.write_text(arms_yaml(**options))
    return file


@contextlib.asynccontextmanager
async def watching(port, *configs, **options):
    """Run a monitor that has printed its first line."""
    more = [word for key, value in options.items() for word in (f"--{key}", str(value))]
    process = await launch("monitor", f"127.0.0.1:{port}", *map(str, configs), *more)
    try:
        assert "watching" in await line_of(process)
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def line_of(process):
    """Return the next line that is not a note on how busy the machine is."""
    async with asyncio.timeout(PATIENCE):
        while "note: states are checked" in (line := (await process.stdout.readline()).decode()):
            pass
    return line


async def ended(process, by=signal.SIGINT):
    """End the monitor; return its exit status and remaining lines."""
    if by is not None:
        process.send_signal(by)
    async with asyncio.timeout(PATIENCE):
        out, err = await process.communicate()
    assert b"Traceback" not in err
    return process.returncode, out.decode().splitlines(), err.decode()


async def ticks_pass(eye):
    """Let a robot tick often enough that a monitor checks states."""
    eye.send(m.Subscribe(robots=("A",), fields=()))
    first = await eye.get(m.State)
    await eye.get(m.State, lambda state: state.tick > first.tick + 40)


async def reset(operator, stop):
    """Reset a stop as soon as the robots are at rest."""
    async with asyncio.timeout(PATIENCE):
        while True:
            operator.send(m.Reset(stop=stop))
            if isinstance(await operator.get((m.Resumed, m.Error)), m.Resumed):
                return
            await asyncio.sleep(0.05)


async def toward_the_post(port):
    """Turn the first joint of A toward the post while that is admitted."""
    raw = await Raw.hello(port, "driver")
    fence = await raw.acquire("A")
    raw.send(m.Subscribe(robots=("A",), fields=("setpoint",)))
    while True:
        state = await raw.get(m.State)
        dq = (0.002, 0.0, 0.0)
        raw.send(m.Command(robot="A", fence=fence, seq=state.tick, tick=state.tick, dq=dq))


@pytest.mark.daily(1)
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
async def test_nothing_is_found_while_robots_move_and_are_stopped_and_reset(tmp_path, by):
    file = config(tmp_path)
    async with Process.serving(file) as daemon, watching(daemon.port, file) as monitor:
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(60)
        operator = await Raw.hello(daemon.port, "operator", "operator")
        operator.send(m.Stop(reason="lunch"))
        stopped = await operator.get(m.Stopped)
        await reset(operator, stopped.stop)
        again = await Mover.start(daemon.port, "A", name="again")
        await again.moves_on(60)
        mover.task.cancel()
        again.task.cancel()
        status, lines, _ = await ended(monitor, by)
        assert status == 0, lines
        assert "no violations" in lines[-1]
        assert int(lines[-1].split()[2]) > 100


@pytest.mark.slow
async def test_a_daemon_on_a_unix_socket_is_monitored(tmp_path):
    file = config(tmp_path, server=f"{{socket: {{path: cell.sock, users: {{{os.getuid()}: observer}}}}}}")
    async with Process.serving(file, "--require-login", host="unix"):
        process = await launch("monitor", f"unix:{tmp_path / 'cell.sock'}", str(file))
        assert "watching" in await line_of(process)
        eye = Raw(*await asyncio.open_unix_connection(tmp_path / "cell.sock"))
        eye.send(m.Hello(versions=(1,), name="eye", role="observer"))
        await eye.get(m.Welcome)
        await ticks_pass(eye)
        status, lines, err = await ended(process)
    assert status == 0, err
    assert "no violations" in lines[-1]


async def test_a_daemon_that_serves_another_cell_is_stopped(tmp_path):
    other = config(tmp_path, "other.yaml")
    other.write_text(other.read_text().replace("[0.05, 1.0]", "[0.06, 1.0]"))
    async with Process.serving(config(tmp_path)) as daemon:
        observer = await Raw.hello(daemon.port, "observer", "observer")
        async with watching(daemon.port, other) as monitor:
            stopped = await observer.get(m.Stopped)
            assert (stopped.by, set(stopped.robots)) == ("monitor", {"A", "B"})
            assert "body post is described with another shape or size" in stopped.reason
            status, lines, _ = await ended(monitor)
    assert status == 1
    assert lines[-1].endswith("1 violation")


async def test_a_violated_clearance_stops_the_cell_and_reports_numbers_and_pair(tmp_path):
    """The monitor's configuration requires more than the daemon's."""
    strict = config(tmp_path, "strict.yaml")
    strict.write_text(strict.read_text().replace("stop_distance: 20 mm", "stop_distance: 46 mm"))
    async with Process.serving(config(tmp_path)) as daemon, watching(daemon.port, strict) as monitor:
        assert "violated: stop_distance" in await line_of(monitor)
        assert "stopped the cell" in await line_of(monitor)
        operator = await Raw.hello(daemon.port, "operator", "operator")
        await reset(operator, 1)
        driver = asyncio.create_task(toward_the_post(daemon.port))
        stopped = await operator.get(m.Stopped, lambda one: one.by == "monitor")
        assert "post" in stopped.reason
        assert "46.000 mm are required" in stopped.reason
        assert "A/" in await line_of(monitor)
        driver.cancel()
        status, _, _ = await ended(monitor)
    assert status == 1


@pytest.mark.slow
async def test_missing_states_are_reported_and_a_lost_daemon_ends_the_monitor(tmp_path):
    file = config(tmp_path)
    async with Process.serving(file) as daemon, watching(daemon.port, file, silence=0.3) as monitor:
        eye = await Raw.hello(daemon.port, "eye", "observer")
        await ticks_pass(eye)
        daemon.signal(signal.SIGSTOP)
        try:
            assert "violated: A, tick" in (first := await line_of(monitor))
            assert "no state for 0." in first
        finally:
            daemon.signal(signal.SIGCONT)
        await ticks_pass(eye)
        os.kill(daemon.process.pid, signal.SIGKILL)
        status, _, err = await ended(monitor, by=None)
    assert status == 1
    assert "no longer monitored" in err


async def test_an_unreadable_configuration_is_rejected(tmp_path):
    file = config(tmp_path)
    async with Process.serving(file) as daemon:
        wrong = config(tmp_path, "wrong.yaml")
        wrong.write_text(wrong.read_text().replace("cylinder", "blob"))
        status, out, err = await run("monitor", f"127.0.0.1:{daemon.port}", wrong)
    assert (status, out) == (2, "")
    assert "surroundings.post.shape.blob" in err
