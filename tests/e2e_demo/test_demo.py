"""The whole stack as a user starts it: daemon, leader and follower as processes of the demo."""

import contextlib
import csv
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgate.apps.stack.observation import Observation, completed
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from support.ports import free_ports
from support.setpoints import check_setpoints

CONFIGS = Path(__file__).parents[2] / "configs"
ARMGATE = [sys.executable, "-m", "armgate.apps"]


def demo(*arguments: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*ARMGATE, "demo", *arguments], capture_output=True, text=True, check=False, cwd=cwd, timeout=300
    )


@contextmanager
def running(cwd: Path, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """Start a demo, and wait until its follower has shared an angle."""
    child = subprocess.Popen(
        [*ARMGATE, "demo", "--no-view", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert child.stdout is not None
        while "°" not in (line := child.stdout.readline()):
            assert line, child.communicate()
        yield child
    finally:
        if child.poll() is None:
            child.kill()
        child.communicate()


def children(pid: int) -> dict[str, int]:
    """Return the children of a demo by their commands."""
    found = {}
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
        found[words[5].decode()] = int(child)
    return found


def ended(pid: int) -> None:
    """Wait until a process that is not our child has ended."""
    with contextlib.suppress(ProcessLookupError):
        handle = os.pidfd_open(pid)
        try:
            assert select.select([handle], [], [], 60.0)[0], f"{pid} still runs"
        finally:
            os.close(handle)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def metrics_of(folder: Path) -> dict[str, Any]:
    metrics: dict[str, Any] = json.loads((folder / "metrics.json").read_text())
    return metrics


def check(metrics: dict[str, Any]) -> None:
    """Check the figures that must hold in every run, on any machine load."""
    assert metrics["complete"] is True
    assert metrics["min_clearance_m"] >= metrics["stop_distance_m"] == 0.05
    assert set(metrics["verdicts"]) == set(metrics["ticks"]) == {"FR", "GR"}
    assert min(metrics["ticks"].values()) > 200


def test_lock_step_from_any_folder_writes_only_its_own_folder(tmp_path: Path) -> None:
    done = demo("--lockstep", "--duration", "3", "--no-view", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (out,) = (tmp_path / "runs").iterdir()
    metrics = metrics_of(out)
    check(metrics)
    assert 0.0 < metrics["angle_error_deg"]["rms"] < metrics["angle_error_deg"]["max"] <= 1.0
    assert metrics["distance_error_m"]["max"] <= 0.02
    assert metrics["holds"] == {"angle": True, "distance": True, "clearance": True, "in_time": True}
    assert metrics["late_commands"] == 0
    assert metrics["states_missed"] == {}
    for verdicts in metrics["verdicts"].values():
        assert (verdicts["limited"], verdicts["refused"]) == ({}, {})
    names = {file.name for file in out.iterdir()}
    pictures = {"angle_error.png", "distance_error.png", "leader_position.png", "clearance.png"}
    data = {"metrics.json", "series.csv", "config.yaml", "recording-0001.mcap", "monitor.json"}
    assert names == pictures | data | {"logs"}
    logs = {"daemon.log", "leader.log", "follower.log", "monitor.log"}
    assert {file.name for file in (out / "logs").iterdir()} == logs
    audited = metrics["monitor"]
    assert (audited["violations"], audited["missed"]) == (0, {})
    assert audited["states"] >= sum(metrics["ticks"].values())  # every state, not only the observed ones
    assert f"monitor: {audited['summary']}" in done.stdout
    with (out / "series.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == metrics["ticks"]["FR"] + 1 - int(rows[0]["time_s"] != "0")
    assert max(float(row["progress"]) for row in rows if row["progress"] != "nan") == 1.0
    assert "holds" in done.stdout
    assert "path" in done.stdout.splitlines()[0]
    # The recording has the states that a slow observer misses.
    found = completed(slow := Observation("FR", missed={"FR": 100}), out, lockstep=False)
    assert found.missed == {}
    series = np.genfromtxt(out / "series.csv", delimiter=",", skip_header=1)
    assert len(found.rows) == len(series) > 200
    assert np.allclose(found.rows, series, atol=1e-8, equal_nan=True)
    assert completed(slow, tmp_path, lockstep=True) is slow


@pytest.mark.slow
def test_two_runs_in_lock_step_give_the_same_series(tmp_path: Path) -> None:
    series = []
    for name in ("a", "b"):
        assert demo("--lockstep", "--duration", "1", "--out", name, cwd=tmp_path).returncode == 0
        series.append((tmp_path / name / "series.csv").read_bytes())
    # The run ends when the observer closes: one observer may receive a few ticks more than the other.
    shorter = min(map(len, series))
    assert shorter > 10_000
    assert series[0][:shorter] == series[1][:shorter]


@pytest.mark.slow
def test_a_demo_by_the_wall_clock(tmp_path: Path) -> None:
    done = demo("--no-view", "--duration", "5", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    metrics = metrics_of(tmp_path / "run")
    check(metrics)
    assert metrics["duration_s"] >= 5.0


def virtual_links(folder: Path, name: str = "rsi-virtual") -> str:
    """Write an overlay with virtual KRCs on unused ports."""
    text = (CONFIGS / "links" / f"{name}.yaml").read_text().replace("../rsi", str(CONFIGS / "rsi"))
    # On a machine busy with other tests a KRC may get no reply for a while.
    timeout = 300 if "period: 4 ms" in text else 100
    text = text.replace("timeout: 100", f"timeout: {timeout}\n      late_in_a_row: 90\n      silence: 1 s")
    for before, port in zip(("49152", "49153"), free_ports(2), strict=True):
        text = text.replace(f"listen: 127.0.0.1:{before}", f"listen: 127.0.0.1:{port}")
    (folder / "links.yaml").write_text(text)
    return str(folder / "links.yaml")


def krc_logs(run: Path, robots: tuple[str, ...] = ("FR", "GR")) -> list[list[dict[str, Any]]]:
    logs = [(run / "logs" / f"krc-{robot}.log").read_text().splitlines() for robot in robots]
    return [[json.loads(line) for line in lines if line.startswith("{")] for lines in logs]


def within_bounds(run: Path, links: str, robots: tuple[str, ...], least: int) -> None:
    """Check the setpoints of each KRC's drives against the cell's bounds in every cycle, except held ones.

    The robot must have moved in at least this number of cycles.
    """
    cell = build_cell(load_config([CONFIGS / "demo.yaml", Path(links)]))
    for robot in robots:
        moved, _ = check_setpoints(run / "logs" / f"krc-{robot}.csv", cell.robot(robot))
        assert moved >= least


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "robots"),
    [("rsi-virtual", ("FR", "GR")), ("rsi-virtual-4ms", ("FR", "GR")), ("mixed", ("FR",))],
)
def test_virtual_krcs_need_only_another_configuration(
    tmp_path: Path, name: str, robots: tuple[str, ...]
) -> None:
    links = virtual_links(tmp_path, name)
    done = demo("--no-view", "--links", links, "--duration", "3", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    check(metrics_of(tmp_path / "run"))
    for lines in krc_logs(tmp_path / "run", robots):
        # On any machine load: the KRC got replies to the end, no drive faulted, and the robot moved.
        assert [line["event"] for line in lines if line["level"] == "error"] == []
        assert lines[-1]["state"] == "running"
        assert lines[-1]["setpoint"] != lines[-1]["programmed"]
    within_bounds(tmp_path / "run", links, robots, least=50)
    log = (tmp_path / "run" / "logs" / "robots.log").read_text()
    assert '"event": "ended", "resting": true' in log


@pytest.mark.slow
@pytest.mark.parametrize(("command", "ends"), [("serve", "running"), ("robot-server", "broken_off")])
def test_after_a_kill_in_motion_krcs_are_answered_or_stop_and_no_drive_faults(
    tmp_path: Path, command: str, ends: str
) -> None:
    links = virtual_links(tmp_path)
    with running(tmp_path, "--links", links, "--out", "run") as child:
        os.kill(children(child.pid)[command], signal.SIGKILL)
        _, err = child.communicate(timeout=120)
    assert child.returncode == 1
    assert "was killed by SIGKILL" in err
    # After an early kill a robot may not have moved yet.
    within_bounds(tmp_path / "run", links, ("FR", "GR"), least=0)
    for lines in krc_logs(tmp_path / "run"):
        assert lines[-1]["state"] == ends
        assert ("KSS29002" in lines[-1]["message"]) == (ends == "broken_off")
        assert "Command" not in lines[-1]["message"]
    if command == "serve":
        robots = (tmp_path / "run" / "logs" / "robots.log").read_text()
        assert '"event": "daemon.gone"' in robots
        assert '"event": "ended", "resting": true' in robots


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_and_writes_the_observed_part(tmp_path: Path) -> None:
    with running(tmp_path, "--lockstep", "--out", "run") as child:
        started = children(child.pid)
        assert set(started) == {"serve", "lead", "follow"}
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=120)
    assert (child.returncode, err) == (0, "")
    assert "ended early" in out
    assert not any(alive(pid) for pid in started.values())
    assert metrics_of(tmp_path / "run")["complete"] is False
    assert "interrupted, at rest" in (tmp_path / "run" / "logs" / "leader.log").read_text()
    assert "interrupted, at rest" in (tmp_path / "run" / "logs" / "follower.log").read_text()
    assert (tmp_path / "run" / "angle_error.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "name"), [("lead", "leader"), ("follow", "follower"), ("serve", "daemon")]
)
def test_a_failed_child_is_named_and_no_process_is_left(tmp_path: Path, command: str, name: str) -> None:
    with running(tmp_path, "--lockstep", "--out", "run") as child:
        started = children(child.pid)
        os.kill(started[command], signal.SIGKILL)
        _, err = child.communicate(timeout=120)
    assert child.returncode == 1
    assert f"the {name} was killed by SIGKILL" in err
    assert "Traceback" not in err
    assert not any(alive(pid) for pid in started.values())
    assert metrics_of(tmp_path / "run")["complete"] is False


@pytest.mark.slow
@pytest.mark.parametrize(("command", "name"), [("lead", "leader"), ("follow", "follower")])
def test_a_run_whose_participant_is_stopped_is_not_complete(tmp_path: Path, command: str, name: str) -> None:
    with running(tmp_path, "--lockstep", "--out", "run") as child:
        os.kill(children(child.pid)[command], signal.SIGINT)
        out, err = child.communicate(timeout=120)
    assert child.returncode == 1
    assert f"the {name} was interrupted before its work was done" in err
    assert "ended early" in out
    assert metrics_of(tmp_path / "run")["complete"] is False


@pytest.mark.slow
def test_a_demo_that_is_killed_leaves_nothing_running(tmp_path: Path) -> None:
    with running(tmp_path, "--lockstep", "--out", "run") as child:
        started = children(child.pid)
        child.kill()
        for pid in started.values():
            ended(pid)
    assert '"event": "closing"' in (tmp_path / "run" / "logs" / "daemon.log").read_text()
