"""``armgate reach`` against a daemon of the planar cell, in lock-step."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from armgate.apps.lead.path import read_path
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.control.redundancy.measures import manipulability
from armgate.control.redundancy.tasks import FrameTask

ARMGATE = [sys.executable, "-m", "armgate.apps"]
PLANAR = Path(__file__).parents[2] / "configs" / "planar.yaml"
MODEL = build_cell(load_config([PLANAR])).robots[0].model
TASK = FrameTask(MODEL, "tool0", ("x", "y"))


@pytest.fixture
def daemon() -> Iterator[str]:
    serve = [*ARMGATE, "serve", str(PLANAR), "--lockstep", "reach", "--port", "0"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("armgate: listening on "), line
            yield line.split()[-1]
        finally:
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=30)


def reach(address: str, *arguments: object) -> "subprocess.CompletedProcess[str]":
    command = [*ARMGATE, "reach", address, "--robot", "P", "--rows", "x,y", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def places(file: Path) -> np.ndarray:
    return np.array([MODEL.frame(q, "tool0").t[:2] for q in read_path(file).q])


@pytest.mark.daily(1)
@pytest.mark.parametrize("method", ["pseudo", "damped", "variable", "transpose"])
def test_every_method_brings_the_tool_to_its_target(daemon: str, tmp_path: Path, method: str) -> None:
    target = (0.3, 0.7, 0.5)
    out = tmp_path / "motion.csv"
    done = reach(daemon, "--method", method, "--target", *target, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("P: target reached in ")
    found = places(out)
    assert np.linalg.norm(found[0] - target[:2]) > 0.4
    assert np.linalg.norm(found[-1] - target[:2]) < 2e-3
    q = read_path(out).q
    np.testing.assert_array_equal(q[-1], q[-2])


@pytest.mark.slow
def test_an_objective_moves_the_joints_and_not_the_tool(daemon: str, tmp_path: Path) -> None:
    away = reach(daemon, "--target", 0.45, 0.45, 0.5, "--out", tmp_path / "away.csv")
    assert away.returncode == 0, away.stderr
    done = reach(daemon, "--objective", "singularities", "--method", "variable", "--out", tmp_path / "a.csv")
    assert done.returncode == 0, done.stderr
    q = read_path(tmp_path / "a.csv").q
    assert np.linalg.norm(places(tmp_path / "a.csv") - places(tmp_path / "a.csv")[0], axis=1).max() < 1e-3
    assert np.abs(q[-1] - q[0]).max() > 0.1
    w = [manipulability(TASK.jacobian(position)) for position in q]
    assert w[-1] > w[0] + 0.005
    # From there, the same target needs no motion.
    again = reach(daemon, "--objective", "singularities", "--method", "variable", "--out", tmp_path / "b.csv")
    assert again.returncode == 0, again.stderr
    assert np.abs(np.ptp(read_path(tmp_path / "b.csv").q, axis=0)).max() < 0.02


@pytest.mark.slow
def test_a_refused_command_ends_reach_with_the_reason(daemon: str) -> None:
    done = reach(daemon, "--target", 0.6, 0.9, 0.5)
    assert (done.returncode, done.stdout) == (1, "")
    assert "stuck" in done.stderr
    assert "post_left" in done.stderr


@pytest.mark.slow
def test_wrong_options_move_no_robot(daemon: str) -> None:
    for wrong in (["--rows", "x,w"], ["--frame", "nose"], ["--robot", "XR"], ["--method", "magic"]):
        done = reach(daemon, *wrong)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        assert wrong[1] in done.stderr
