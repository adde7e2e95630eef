"""The controller in the README, word for word, drives a robot of a real daemon."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from armgate.client import connect

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = "127.0.0.1:7411"
ENOUGH = 20


@contextmanager
def running(command: list[str], end: signal.Signals) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(end)
                process.communicate(timeout=20)


def ten_lines(document: str) -> str:
    text = (ROOT / document).read_text(encoding="utf-8")
    found = re.search(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture
def daemon_address() -> Iterator[str]:
    serve = [sys.executable, "-m", "armgate.apps", "serve", "configs/demo.yaml", "--port", "0"]
    with running(serve, signal.SIGTERM) as daemon:
        assert daemon.stdout is not None
        line = daemon.stdout.readline()
        assert line.startswith("armgate: listening on "), line
        yield line.split()[-1]
        daemon.terminate()
        log = daemon.communicate(timeout=20)[1]
    assert daemon.returncode == 0, log


def test_readme_and_guide_show_the_same_controller() -> None:
    program = ten_lines("README.md")
    assert program == ten_lines("docs/controllers.md")
    assert len([line for line in program.splitlines() if line.strip()]) <= 10


def test_the_controller_of_the_readme_moves_a_robot(daemon_address: str) -> None:
    program = ten_lines("README.md")
    assert ADDRESS in program
    controller = [sys.executable, "-c", program.replace(ADDRESS, daemon_address)]
    with connect(daemon_address, name="watcher", role="observer") as cell:
        cell.subscribe(every=1)
        with running(controller, signal.SIGINT) as process:
            for state in cell.states():
                assert process.poll() is None, process.communicate()[1]
                entry = next(entry for entry in state.entries if entry.robot == "FR")
                start = next(robot.start for robot in cell.description.robots if robot.name == "FR")
                if (entry.counts or {}).get("admitted", 0) >= ENOUGH and entry.setpoint[0] > start[0]:
                    break
