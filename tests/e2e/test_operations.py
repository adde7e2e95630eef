"""Metrics of a running daemon, and a required recording on a full disk."""

import asyncio
import errno
import json
import os
import resource
import sys

import pytest

from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.clients import PATIENCE, Mover, Process, Raw, run


async def test_metrics_are_served_and_printed(tmp_path):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml(max_age_ticks=1000, metrics="{port: 0}"))
    async with Process.serving(file) as daemon:
        async with asyncio.timeout(PATIENCE):
            port = None
            while port is None:
                line = json.loads(await daemon.process.stderr.readline())
                port = line["port"] if line["event"] == "metrics" else None
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(10)
        status, out, err = await run("status", "--port", port)
        await mover.stop()
    assert (status, err) == (0, "")
    for part in (
        "Decided commands",
        "A admitted: ",
        "Lateness of ticks when they are processed",
        "99 % below",
        "A ready: 1",
    ):
        assert part in out
    assert "sessions: 1" in out
    assert "unread_bytes_of_one: 0" in out
    for place in (("--port", port), (f"127.0.0.1:{port}",)):
        status, out, err = await run("status", *place)
        assert (status, out) == (1, "")
        assert "metrics.port" in err


@pytest.mark.slow
async def test_status_takes_an_address_and_reports_its_errors(tmp_path):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml(metrics="{port: 0}"))
    async with Process.serving(file) as daemon:
        async with asyncio.timeout(PATIENCE):
            port = None
            while port is None:
                line = json.loads(await daemon.process.stderr.readline())
                port = line["port"] if line["event"] == "metrics" else None
        status, out, err = await run("status", f"127.0.0.1:{port}")
        assert (status, err) == (0, "")
        assert "sessions: 0" in out
        status, out, err = await run("status", f"127.0.0.1:{daemon.port}")
        assert (status, out) == (1, "")
        assert f"127.0.0.1:{daemon.port} serves no metrics" in err
    for wrong in ("nowhere", ":7412", "a:0", "a:99999", "u@a:1", "a:1/x"):
        status, out, err = await run("status", wrong)
        assert (status, out) == (2, "")
        assert "expected HOST:PORT" in err


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
from armgate.apps.cli import main
main(sys.argv[2:])
"""


async def limited(file, out, room):
    """Start a daemon whose files cannot grow beyond ``room`` bytes."""
    return await asyncio.create_subprocess_exec(
        sys.executable, "-c", LIMITED, str(room), "serve", str(file), "--port", "0", "--record", str(out),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip


async def watched(tmp_path, recording):
    """Return the first state with a warning about the recording, and a later one; replay the recording."""
    file, out = tmp_path / "arms.yaml", tmp_path / "run"
    file.write_text(arms_yaml(recording=recording))
    process = await limited(file, out, 60_000)
    try:
        async with asyncio.timeout(PATIENCE):
            port = int((await process.stdout.readline()).decode().rpartition(":")[2])
        eye = await Raw.hello(port, "eye", "observer")
        eye.send(m.Subscribe())
        warned = await eye.get(m.State, lambda s: any("recording ended" in w for w in s.warnings))
        after = await eye.get(m.State, lambda s: s.tick > warned.tick + 5)
        process.terminate()
        await Raw.close_all()
        async with asyncio.timeout(PATIENCE):
            await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()
    assert process.returncode == 1
    assert (await run("recover", out))[0] == 0
    assert (await run("replay", out))[0] == 0
    return warned, after


@pytest.mark.slow
async def test_a_full_disk_ends_the_recording_and_is_reported(tmp_path):
    warned, after = await watched(tmp_path, "{required: false}")
    assert any("recording-0001.mcap" in warning for warning in warned.warnings)
    assert not any(entry.stops for entry in after.entries)


@pytest.mark.slow
async def test_robots_rest_if_a_required_recording_fails(tmp_path):
    _, after = await watched(tmp_path, "{required: true}")
    assert all(entry.stops for entry in after.entries)


@pytest.mark.daily(1)
@pytest.mark.parametrize("required", ["true", "false"])
async def test_a_disk_that_fills_exactly_at_the_end_is_reported(tmp_path, required):
    file, out = tmp_path / "arms.yaml", tmp_path / "run"
    file.write_text(arms_yaml(recording=f"{{required: {required}}}"))
    async with Process.serving(file, "--record", out) as daemon:
        size = (out / "recording-0001.mcap").stat().st_size
        resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (size, size))
        daemon.signal()
        status, log = await daemon.end()
    assert status == 1
    assert any(os.strerror(errno.EFBIG) in line["text"] for line in log if line["event"] == "recording")
