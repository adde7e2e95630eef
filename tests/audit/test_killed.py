"""Record, kill -9, recover, replay: in every state of the writer, at random moments, with a real daemon."""

import errno
import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from armgate.audit import recover
from armgate.audit.recorded_cell import recorded_cell
from armgate.audit.recover import recover_recording
from armgate.audit.replay import replay_recording
from armgate.recording import DamagedError, Recording, RecordingError, TruncatedError
from armgate.recording.scan import scan
from support import records
from support.cells import arms_yaml
from support.clients import Mover, Process, Raw, run

STATES = ("between", "in_chunk", "after_chunk", "turn_closed", "turn_begun", "closing")
CHILD = Path(__file__).parents[1] / "support" / "killed_recorder.py"


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Return the folder, and for each case the number of steps flushed before the kill."""
    folder = tmp_path_factory.mktemp("killed")
    chance = random.Random(20)
    moments = [str(n) for n in chance.sample(range(3, 400), 20)]
    command = [sys.executable, str(CHILD), str(folder), "start", *STATES, *moments]
    environment = os.environ | {"PYTHONPATH": str(CHILD.parents[1])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=300)
    cases = [json.loads(line) for line in done.stdout.splitlines()]
    assert {case["status"] for case in cases} == {-signal.SIGKILL}
    return folder, {case["case"]: case["flushed"] for case in cases}


def replayed_events(folder):
    """Check that all remaining steps replay identically; return their number."""
    recover_recording(folder)
    recording = Recording.open(folder)
    outcome = replay_recording(recording, recorded_cell(recording.header))
    assert outcome.count == 0
    return outcome.events


@pytest.mark.slow
@pytest.mark.parametrize("state", STATES)
def test_flushed_events_replay_identically_after_a_kill_in_any_state_of_the_writer(killed, state):
    folder, flushed = killed
    if state != "turn_closed":  # in this case every file was closed, and no new file was begun
        with pytest.raises(TruncatedError, match="armgate recover"):
            Recording.open(folder / state)
    assert replayed_events(folder / state) >= flushed[state] > 0


@pytest.mark.slow
def test_flushed_events_replay_identically_after_kills_at_twenty_random_moments(killed):
    folder, flushed = killed
    moments = [name for name in flushed if name.isdigit()]
    left = {name: replayed_events(folder / name) for name in moments}
    assert len(left) == 20
    assert all(left[name] >= flushed[name] for name in moments)
    assert len(set(left.values())) > 10


def test_a_writer_killed_at_its_start_leaves_nothing_to_recover(killed):
    folder, _ = killed
    with pytest.raises(RecordingError, match="nothing can be recovered"):
        recover_recording(folder / "start")


def test_a_file_with_a_damaged_header_is_refused_and_stays_unchanged(tmp_path):
    records.write(tmp_path, range(300))
    file = tmp_path / "recording-0001.mcap"
    content = bytearray(file.read_bytes())
    place = scan(file).chunks[0]
    content[place.offset + place.length // 2] ^= 0xFF
    file.write_bytes(content)
    with pytest.raises(DamagedError, match="restore it from a copy"):
        recover_recording(tmp_path)
    assert file.read_bytes() == content
    assert [one.name for one in tmp_path.iterdir()] == [file.name]


def test_a_file_stays_unchanged_and_an_error_is_reported_if_the_disk_is_full(tmp_path, monkeypatch):
    records.write(tmp_path, range(300))
    file = tmp_path / "recording-0001.mcap"
    file.write_bytes(file.read_bytes()[:-20])
    before = file.read_bytes()

    def full(_old, new):
        new.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(recover, "recover_file", full)
    with pytest.raises(RecordingError, match=r"No space left on device; \d+ bytes are needed"):
        recover_recording(tmp_path)
    assert file.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == [file.name]


async def test_the_recording_of_a_killed_daemon_is_recovered_and_replays_identically(tmp_path):
    file, out = tmp_path / "arms.yaml", tmp_path / "run"
    file.write_text(arms_yaml(lag=0.03, max_age_ticks=1000))
    async with Process.serving(file, "--record", out) as daemon:
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(30)
        daemon.signal(signal.SIGKILL)
        await mover.ended()
        await Raw.close_all()
        await daemon.process.wait()
    status, text, err = await run("replay", out)
    assert (status, text) == (1, "")
    assert f"armgate recover {out}" in err
    status, text, _ = await run("recover", out)
    assert (status, "recovered" in text) == (0, True)
    status, text, _ = await run("replay", out)
    assert status == 0
    assert "bit for bit" in text
    assert (await run("recover", out))[1].strip().endswith("complete, nothing to recover")
