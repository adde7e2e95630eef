"""The paper's experiments as a user starts them, shortened: every process, every file, every figure."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from armgate.apps.stack.observation import Observation

ARMGATE = [sys.executable, "-m", "armgate.apps"]
DEMO = Path(__file__).parents[2] / "configs" / "demo.yaml"
TOUR = DEMO.parent / "paths" / "inspection.csv"
HEAD = "armgate: 1\nseeds: 9\nfirst_seed: 7\n"
BOX = "box: {middle: [2.0, 0, 1.0], half: [0.3, 0.7, 0.35]}\n"
TRACKING = f"""{HEAD}experiment: tracking
seconds: 5
{BOX}cases:
  - {{name: slow, speed: 0.25 m/s, lag: 0 ms, predict: false}}
  - {{name: slow-predicted, speed: 0.25 m/s, lag: 0 ms, predict: true}}
"""
ZOOM = f"{HEAD}experiment: zoom\nseconds: 3.5\nspeed: 0.1\nlag: 30 ms\nlow: 0.9\nhigh: 1.1\nrate: 0.1\n{BOX}"
COLLISION = f"""{HEAD}experiment: collision
seconds: 0.1
focus: [2.0, 0, 1.0]
way: 1.5
speeds: [1.0]
lag: 30 ms
"""


def experiment(name: str, text: str, folder: Path, *options: str) -> dict[str, Any]:
    """Run an experiment; return the content of its ``metrics.json``."""
    file = folder / f"{name}.yaml"
    file.write_text(text)
    command = [*ARMGATE, "experiment", name, "--file", str(file), "--seeds", "1", "--out", "run", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    assert "claim" in done.stdout
    found: dict[str, Any] = json.loads((folder / "run" / name / "metrics.json").read_text())
    together = json.loads((folder / "run" / "metrics.json").read_text())
    assert together["claims"] == [{"experiment": name, **row} for row in found["claims"]]
    page = (folder / "run" / name / "report.html").read_text()
    assert page.count("data:image/png") == len(found["aggregate"])
    return found


def holding(found: dict[str, Any], text: str) -> bool | None:
    (holds,) = [row["holds"] for row in found["claims"] if text in row["claim"]]
    return holds  # type: ignore[no-any-return]


@pytest.mark.slow
def test_tracking(tmp_path: Path) -> None:
    found = experiment("tracking", TRACKING, tmp_path)
    slow, predicted = found["entries"]
    assert (slow["case"], slow["seed"], predicted["case"]) == ("slow", 7, "slow-predicted")
    assert slow["complete"]
    assert 0.0 < predicted["moving_rms_deg"] < slow["moving_rms_deg"] / 3.0
    assert holding(found, "0.25 m/s, no lag, without prediction: angle") is True
    assert holding(found, "0.25 m/s: ratio") is True
    assert holding(found, "late commands") is True
    folder = tmp_path / "run" / "tracking" / "slow-7"
    assert {"path.csv", "overlay.yaml", "series.csv", "metrics.json", "logs"} <= {
        file.name for file in folder.iterdir()
    }


@pytest.mark.slow
def test_zoom_with_an_operator_process(tmp_path: Path) -> None:
    (entry,) = experiment("zoom", ZOOM, tmp_path, "--sockets")["entries"]
    assert 0.9 <= entry["wanted_m"]["min"] < entry["wanted_m"]["max"] <= 1.1
    assert entry["quiet_share"] == 1.0
    assert entry["quiet_distance_m"] < 0.02


@pytest.mark.slow
def test_collision_by_the_wall_clock(tmp_path: Path) -> None:
    found = experiment("collision", COLLISION, tmp_path, "--realtime")
    (entry,) = found["entries"]
    assert found["realtime"] is True
    assert entry["min_clearance_m"] >= 0.05
    assert 0.5 < entry["realtime_factor"] < 1.5


def test_a_wrong_file_is_reported_before_any_process_starts(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(ZOOM.replace("low: 0.9", "low: tall"))
    command = [*ARMGATE, "experiment", "zoom", "--file", str(file), "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert re.search(r"x\.yaml:8: low: cannot read 'tall'", done.stderr), done.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_runs_in_worlds_are_kept_and_not_repeated(tmp_path: Path) -> None:
    def started(*options: str) -> "subprocess.CompletedProcess[str]":
        command = [
            *ARMGATE,
            "experiment",
            "zoom",
            "--file",
            str(file),
            "--seeds",
            "2",
            "--out",
            "run",
            *options,
        ]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=300)

    file = tmp_path / "zoom.yaml"
    file.write_text(ZOOM)
    first = started("--jobs", "2")
    assert (first.returncode, first.stderr) == (0, "")
    folders = [tmp_path / "run" / "zoom" / name for name in ("zoom-7", "zoom-8")]
    kept, lost = (folder / "metrics.json" for folder in folders)
    before, made = lost.read_bytes(), kept.stat().st_mtime_ns
    lost.unlink()
    again = started()
    assert again.returncode == 0
    assert lost.read_bytes() == before
    assert kept.stat().st_mtime_ns == made
    assert json.loads(before)["monitor"]["violations"] == 0
    file.write_text(ZOOM.replace("rate: 0.1", "rate: 0.2"))
    changed = started()
    assert changed.returncode == 2
    assert "experiments.zoom.rate: 0.1 before, 0.2 now" in changed.stderr


@pytest.mark.slow
def test_ctrl_c_keeps_the_finished_runs(tmp_path: Path) -> None:
    file = tmp_path / "tracking.yaml"
    file.write_text(TRACKING)
    command = [*ARMGATE, "experiment", "tracking", "--file", str(file), "--seeds", "1", "--out", "run"]
    with subprocess.Popen(
        [*command, "--sockets"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    ) as process:
        assert process.stdout is not None
        assert any("1/2" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        printed, why = process.communicate(timeout=120)
    assert process.returncode == 1
    assert why.startswith(
        "armgate: incomplete, the finished runs are in run: 1 of 2 runs, then: interrupted"
    ), why
    assert "claim" in printed
    found = json.loads((tmp_path / "run" / "tracking" / "metrics.json").read_text())
    assert [entry["case"] for entry in found["entries"]] == ["slow"]
    assert "Incomplete" in (tmp_path / "run" / "tracking" / "report.html").read_text()


@pytest.fixture
def daemon() -> Iterator[str]:
    serve = [*ARMGATE, "serve", str(DEMO), "--lockstep", "leader,follower", "--port", "0"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().split()[-1]
        finally:
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=30)


def test_a_lost_leader_process_brings_the_follower_to_rest(daemon: str) -> None:
    lead = [*ARMGATE, "lead", daemon, "--path", str(TOUR), "--name", "leader"]
    follow = [*ARMGATE, "follow", daemon, "--robot", "FR", "--leader", "GR", "--name", "follower"]
    with (
        subprocess.Popen(lead, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as leader,
        subprocess.Popen(follow, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as follower,
    ):
        _wait_for_progress(daemon)
        leader.kill()
        _, printed = follower.communicate(timeout=60)
    assert follower.returncode == 1
    assert re.search(r"FR is at rest: the leader disconnected at \d+ % of its path", printed), printed


def test_a_pursuing_leader_approaches_as_far_as_the_gate_admits(daemon: str) -> None:
    lead = [*ARMGATE, "lead", daemon, "--robot", "GR", "--pursue", "FR/link_3", "--tool-speed", "1.0"]
    follow = [*ARMGATE, "follow", daemon, "--robot", "FR", "--leader", "GR", "--focus", "2", "0", "1"]
    with (
        subprocess.Popen(lead, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as leader,
        subprocess.Popen(
            [*follow, "--duration", "3"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as follower,
    ):
        seen = _watch(daemon, 2.9)
        assert follower.communicate(timeout=60) == ("FR: duration has passed, at rest\n", "")
        leader.send_signal(signal.SIGINT)
        printed, why = leader.communicate(timeout=60)
    assert (follower.returncode, leader.returncode, why) == (0, 0, "")
    assert printed.endswith("GR: interrupted, at rest\n"), printed
    apart, pair = seen.nearest or (1.0, ("", ""))
    assert 0.05 <= apart < 0.3
    assert {name.partition("/")[0] for name in pair} == {"FR", "GR"}
    assert seen.least_clearance is not None
    assert seen.least_clearance >= 0.05
    assert seen.scalar("follow.repulsion") == 1.0
    assert abs(seen.scalar("follow.distance_error") or 0.0) > 0.05  # it evaded …
    assert (seen.scalar("follow.angle_error") or 0.0) < 0.02  # … and kept the view


def _watch(address: str, seconds: float) -> Observation:
    from armgate.client import connect

    seen = Observation("FR")
    with connect(address, name="watch", role="observer") as cell:
        cell.subscribe(every=1, robots=["FR"])
        for state in cell.states():
            seen.take(state)
            if seen.elapsed >= seconds:
                return seen
    raise AssertionError("the daemon ended")


def _wait_for_progress(address: str) -> None:
    from armgate.client import connect

    with connect(address, name="watch", role="observer") as cell:
        for state in cell.states():
            printed = state.signals.get("lead.progress")
            if printed is not None and printed.value[0] > 0.02:
                return
