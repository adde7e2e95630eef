"""The tutorials are true: their files are saved, their commands run, their outputs appear."""

import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from armgate.client import connect

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = "127.0.0.1:7411"
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
TIMEOUT = 120.0


class Process:
    """Command of a tutorial that keeps running, and the lines that it has printed."""

    def __init__(self, command: list[str], folder: Path) -> None:
        self.popen = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            with self._changed:
                self.lines.append(line)
                self._changed.notify_all()

    def wait_for(self, text: str) -> str:
        """Return the first line with this text."""
        with self._changed:
            found = self._changed.wait_for(lambda: [line for line in self.lines if text in line], TIMEOUT)
        assert found, "".join(self.lines)
        return found[0]

    def type(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(f"{line}\n")
        self.popen.stdin.flush()

    def end(self, sign: signal.Signals = signal.SIGINT) -> int:
        if self.popen.poll() is None:
            self.popen.send_signal(sign)
        code = self.popen.wait(60)
        self._reader.join(10)
        for stream in (self.popen.stdin, self.popen.stdout):
            assert stream is not None
            stream.close()
        return code


class Tutorial:
    """Page in a folder that looks like a checkout, with free ports instead of the usual ones."""

    def __init__(self, name: str, folder: Path, stack: ExitStack) -> None:
        text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        self.blocks = [match.groups() for match in BLOCK.finditer(text)]
        self.text = text
        self.folder = folder
        self.ports: dict[str, str] = {}
        self._stack = stack
        (folder / "configs").symlink_to(ROOT / "configs")
        (folder / ".venv").symlink_to(sys.prefix)

    def command(self, part: str) -> list[str]:
        """Return the only command of the page that contains this."""
        lines = [line for kind, _, text in self.blocks if kind == "sh" for line in text.splitlines()]
        found = {line for line in lines if part in line}
        assert len(found) == 1, found
        return shlex.split(found.pop())

    def save(self, name: str, version: int = 0) -> Path:
        """Save a file of the page; ``version`` selects one of several with this name."""
        texts = [text for _, title, text in self.blocks if title == name]
        text = texts[version]
        for usual, free in self.ports.items():
            text = text.replace(usual, free)
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    def run(self, part: str, status: int = 0) -> str:
        """Run the command that contains this, and return what it prints."""
        done = subprocess.run(
            self.command(part), cwd=self.folder, capture_output=True, text=True, check=False, timeout=TIMEOUT
        )
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    def start(self, part: str, *more: str) -> Process:
        process = Process([*self.command(part), *more], self.folder)
        self._stack.callback(process.end)
        return process

    def serve(self, part: str) -> Process:
        """Start the daemon of the page on a free port."""
        daemon = self.start(part, "--port", "0")
        line = daemon.wait_for("armgate: listening on")
        found = re.search(r"armgate: listening on ([\d.]+:\d+)", line)
        assert found is not None, line
        self.ports[ADDRESS] = found[1]
        return daemon

    def shows(self, output: str) -> bool:
        """Return True if the page shows this line, apart from its numbers."""
        numbers = re.compile(r"\d+(?:\.\d+)?")
        return numbers.sub("0", output.strip()) in numbers.sub("0", self.text)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


@pytest.mark.slow
def test_first_controller(tmp_path: Path, stack: ExitStack) -> None:
    page = Tutorial("first-controller", tmp_path, stack)
    assert page.command("make install") == ["make", "install"]
    daemon = page.serve("armgate serve")
    for name in ("wave.py", "turn.py", "stop.py"):
        page.save(name)
    wave = page.start("wave.py")
    with connect(page.ports[ADDRESS], name="test", role="observer") as cell:
        cell.subscribe(every=1)
        for state in cell.states():
            assert wave.popen.poll() is None, wave.lines
            if (state.entries[0].counts or {}).get("admitted", 0) >= 20:
                break
    wave.end()
    refused = page.run("turn.py")
    assert page.shows(refused), refused
    assert "P can be commanded again" in page.run("stop.py")
    assert daemon.end() == 0
    assert refused.strip() in page.run("armgate explain")
    page.run("armgate replay")


def test_your_own_robot(tmp_path: Path, stack: ExitStack) -> None:
    page = Tutorial("your-own-robot", tmp_path, stack)
    page.run("mkdir mycell")
    page.run("cp configs")
    page.save("mycell/cell.yaml", 0)
    error = page.run("armgate check", status=2)
    assert error.strip() in page.text
    page.save("mycell/cell.yaml", 1)
    near = next(
        line for line in page.run("armgate check", status=1).splitlines() if "apart at the start" in line
    )
    assert near in page.text
    page.save("mycell/cell.yaml", 2)
    last = page.run("armgate check").strip().splitlines()[-1]
    assert f"`{last}`" in page.text
    page.serve("armgate serve")
    with connect(page.ports[ADDRESS], name="test") as cell, cell.acquire("ARM") as robot:
        next(iter(robot.ticks()))
        assert robot.send([0.001, 0.0, 0.0]).outcome == "admitted"


@pytest.mark.slow
def test_first_kuka_motion(tmp_path: Path, stack: ExitStack) -> None:
    page = Tutorial("first-kuka-motion", tmp_path, stack)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        page.ports["127.0.0.1:49152"] = f"127.0.0.1:{free.getsockname()[1]}"
    page.save("kuka/cell.yaml")
    page.run("rsi config")
    last = page.run("armgate check").strip().splitlines()[-1]
    assert f"`{last}`" in page.text
    page.start("robot-server").wait_for("robot server at")
    page.serve("armgate serve")
    controller = page.start("armgate krc")
    controller.wait_for("sends from port")
    page.save("kuka/move.py")
    page.save("kuka/reset.py")
    moved = page.run("kuka/move.py")
    assert f"`{moved.strip()}`" in page.text
    controller.type("estop")
    controller.wait_for("estopped")
    controller.type("restart")
    assert "FR is ready" in page.run("kuka/reset.py")
