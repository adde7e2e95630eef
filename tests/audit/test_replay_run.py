"""``armgate replay``: a recorded run of the daemon, replayed with the same and with other values."""

import pytest

from armgate.recording import Recording, StateSeries
from support.cells import arms_yaml
from support.clients import Mover, Process, Raw, run


async def moved(tmp_path, *options, count=30, **cell):
    """Record a run in which A moves, and return its folder."""
    file, out = tmp_path / "arms.yaml", tmp_path / "run"
    file.write_text(arms_yaml(max_age_ticks=1000, **cell))
    async with Process.serving(file, "--record", out, *options) as daemon:
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(count)
        daemon.signal()
        await mover.ended()
        await Raw.close_all()
        status, _ = await daemon.end()
    assert status == 0
    return out


async def test_a_replay_is_identical_and_differs_with_other_values(tmp_path):
    out = await moved(tmp_path, lag=0.03)
    status, text, err = await run("replay", out)
    assert (status, err) == (0, "")
    recording = Recording.open(out)
    events = list(recording.steps())
    assert text.startswith(f"{len(events)} of {len(events)} events")
    assert "have the same outputs, bit for bit" in text
    status, text, _ = await run("replay", out, "--set", "robots.A.joints.J1.velocity=0.01")
    assert status == 0
    assert "A: admitted → limited by" in text
    series = StateSeries(recording)
    state = series.at(series.end)
    assert [entry.robot for entry in state.entries] == ["A", "B"]
    assert state.entries[0].counts["admitted"] >= 30
    assert series.description.hash == recording.header.hash


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("stop_distance", "expected KEY.PATH=VALUE"),
        ("stop_distanc=1", "did you mean 'stop_distance'"),
        ("stop_distance=-1", "expected more than 0"),
        ("stop_distance=[", "is not a value"),
        ("clock.kind=wall", "no verdict depends on clock"),
        ("robots.A.joints.joint_9.velocity=1", "joint_9"),
    ],
)
async def test_an_invalid_setting_is_an_error(setting, text, one_run):
    status, out, err = await run("replay", one_run, "--set", setting)
    assert (status, out) == (2, "")
    assert text in err
    assert "Traceback" not in err
