"""The program in docs/controllers.md runs over a connection and in a world, with the same decisions."""

import contextlib
import io
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from armgate.recorder import WorldRecorder
from armgate.recording import Recording
from armgate.recording.codec import CellState, RobotState, encode
from armgate.world import World

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## Write a controller once")[2].partition("\n## ")[0]
PROGRAM, CONNECTED, IN_A_WORLD = re.findall(r"^```python\n(.*?)^```$", SECTION, re.MULTILINE | re.DOTALL)
SHORT = "Wave(1.0)"


def executed(code: str, names: dict[str, Any]) -> str:
    assert "Wave(10.0)" in code
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(code.replace("Wave(10.0)", SHORT), names)
    return output.getvalue()


def states(folder: Path) -> list[bytes]:
    """Return the recorded states until the robot is released."""
    found: list[bytes] = []
    held = False
    recording = Recording.open(folder)
    for _, item in recording.items():  # noqa: PERF102 (not those of a dict)
        if isinstance(item, RobotState) and item.entry.robot == "FR":
            if held and item.entry.holder is None:
                break
            held = held or item.entry.holder is not None
        if isinstance(item, RobotState | CellState):
            found.append(encode(item)[1])
    return found


def test_a_program_runs_over_a_connection_and_in_a_world_with_the_same_decisions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(PROGRAM, names)
    serve = [
        "serve",
        "configs/demo.yaml",
        "--lockstep",
        "wave",
        "--port",
        "0",
        "--record",
        str(tmp_path / "a"),
    ]
    command = [sys.executable, "-m", "armgate.apps", *serve]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as daemon:
        assert daemon.stdout is not None
        address = daemon.stdout.readline().split()[-1]
        assert executed(CONNECTED.replace("127.0.0.1:7411", address), names) == "ended\n"
        daemon.send_signal(signal.SIGTERM)
        daemon.communicate(timeout=30)
    with WorldRecorder(tmp_path / "b") as recorder:
        load = World.load
        monkeypatch.setattr(
            World, "load", lambda *files, **options: load(*files, recorders=[recorder], **options)
        )
        assert executed(IN_A_WORLD, names).startswith("ended 1.0")
    connected, in_a_world = states(tmp_path / "a"), states(tmp_path / "b")
    assert len(in_a_world) > 200
    assert connected[: len(in_a_world)] == in_a_world
