"""The worked examples of CONTRIBUTING.md are true: their packages install and work, their files exist."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from armgate.client import connect

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
TITLED = re.compile(r'^```\w+ title="([^"]+)"\n(.*?)^```$', re.MULTILINE | re.DOTALL)
TIMEOUT = 120.0


@pytest.fixture
def address() -> Iterator[str]:
    serve = [sys.executable, "-m", "armgate.apps", "serve", "configs/planar.yaml", "--port", "0"]
    with subprocess.Popen(
        serve, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as daemon:
        assert daemon.stdout is not None
        yield daemon.stdout.readline().split()[-1]
        daemon.terminate()


def installed(name: str, folder: Path) -> Path:
    """Install the example package of this folder into a folder of its own."""
    for title, text in TITLED.findall(TEXT):
        path = folder / title
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    target = folder / "site"
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
    ]
    done = subprocess.run(
        [*install, "--disable-pip-version-check", "--target", str(target), str(folder / name)],
        capture_output=True, text=True, check=False, timeout=TIMEOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return target


def armgate(site: Path, address: str, command: str) -> subprocess.CompletedProcess[str]:
    """Run the only command of the document that begins with ``command``."""
    (line,) = re.findall(rf"^\.venv/bin/armgate ({command} .*)$", TEXT, re.MULTILINE)
    words = line.replace("127.0.0.1:7411", address).split()
    environment = os.environ | {"PYTHONPATH": str(site)}
    return subprocess.run(
        [sys.executable, "-m", "armgate.apps", *words],
        capture_output=True, text=True, check=False, timeout=TIMEOUT, env=environment, cwd=ROOT,
    )  # fmt: skip


@pytest.mark.slow
def test_the_example_of_an_input_drives_a_robot(tmp_path: Path, address: str) -> None:
    done = armgate(installed("swing", tmp_path), address, "lead")
    assert done.returncode == 0, done.stderr
    assert "two seconds are over" in done.stdout + done.stderr


@pytest.mark.slow
def test_the_example_of_a_control_law_moves_a_robot(tmp_path: Path, address: str) -> None:
    done = armgate(installed("home", tmp_path), address, "home")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout == "P is at zero\n"
    with connect(address, name="test", role="observer") as cell:
        cell.subscribe(every=1)
        state = next(iter(cell.states()))
    assert max(map(abs, state.entries[0].setpoint)) < 1e-4


@pytest.mark.slow
def test_the_example_of_a_link_is_checked(tmp_path: Path) -> None:
    copy = shutil.copytree(ROOT / "examples" / "linebot", tmp_path / "linebot")
    done = armgate(installed(copy.name, tmp_path), "", "check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "linebot" in done.stdout


def test_the_files_in_the_lists_exist() -> None:
    named = set(re.findall(r"`((?:protocol|sim|server|client|tests|tools|docs)/[\w/.-]+)`", TEXT))
    assert len(named) > 20
    missing = [name for name in sorted(named) if "NAME" not in name and not (ROOT / name).exists()]
    assert missing == []


def test_the_names_in_the_examples_exist() -> None:
    checks = (ROOT / "server/armgate/gate/command_checks.py").read_text(encoding="utf-8")
    (table,) = re.findall(r"^_CHECKS: .*$", checks, re.MULTILINE)
    assert table.removesuffix(")") in TEXT
    for name in re.findall(r"In `(\w+\.py)`", TEXT):
        assert any(ROOT.glob(f"*/armgate/*/{name}")), f"{name} does not exist"
    for module in re.findall(r"return (\w+)\.reversal\(", TEXT):
        assert f"from armgate.gate import {module}\n" in checks
    messages = (ROOT / "protocol/armgate/protocol/messages.py").read_text(encoding="utf-8")
    for name in ("class Request(", "class Answer(", "ClientMessage", "ServerMessage", "ANSWERS", "Finite"):
        assert name in messages
    assert "MEANINGS" in (ROOT / "server/armgate/gate/verdict_wording.py").read_text(encoding="utf-8")
