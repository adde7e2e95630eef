"""Trials with commands: a daemon in lock-step, and a process or a thread for each controller.

The result depends only on the controllers, not on their speed: time is virtual, and the series ends at the
planned duration, or when the last awaited participant releases its robot.
"""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from armgate.campaign import launch
from armgate.campaign.series import Series
from armgate.cell.config import CellConfig, MetricsConfig, RecordingConfig, ServerConfig
from armgate.cell.config.packing import pack, unpack
from armgate.client import Cell, ClientError, connect
from armgate.client.program import ProgramContext, run
from armgate.programs import Controller

LISTENING = re.compile(r"^armgate: listening on (\S+)$")
START_TIME = 120.0
"""Timeout for the daemon to listen, s."""
END_TIME = 20.0
"""Timeout for a process to bring its robot to rest and end, s."""
_ENDED = (0, 128 + signal.SIGINT)
"""Exit statuses of a daemon that was requested to end."""
_LOOK = 0.02
"""Period in which ends of processes are noticed, s."""


class CommandError(Exception):
    """Command or daemon that failed in a trial."""


@dataclass(frozen=True)
class Command:
    """Command of one participant, with all its arguments, and its robot."""

    words: tuple[str, ...]
    robot: str | None


class _Member(Protocol):
    """Controller that runs beside the daemon."""

    robot: str | None

    def ended(self) -> bool:
        """Return True if it has ended; raise `CommandError` if it failed."""

    def stop(self) -> None:
        """Request its end."""


def run_with_daemon(
    config: CellConfig,
    members: Mapping[str, Command | Controller],
    duration: float,
    until: Collection[str],
    recording: Path | None,
) -> Series:
    """Run controllers with a daemon in lock-step, and return the series of its recording.

    Args:
        config: Configuration of the cell.
        members: Controllers by participant; ``{address}`` and ``{name}`` in words of commands are filled in.
        duration: Longest duration, virtual time, s.
        until: Participants whose end ends the trial; empty: all.
        recording: Folder for the recording; None: it is removed afterwards.

    Raises:
        CommandError: The daemon or a controller failed.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="armgate-trial-")))
        record = recording or folder / "recording"
        with _daemon(config, list(members), folder, record) as address:
            _run(address, members, folder, duration, until)
        awaited = [member.robot for name, member in members.items() if not until or name in until]
        return Series.of(record, duration, [robot for robot in awaited if robot is not None])


@contextmanager
def _daemon(config: CellConfig, names: Sequence[str], folder: Path, record: Path) -> Iterator[str]:
    """Start a daemon; yield its address, and end it."""
    plain = config.model_copy(
        update={"server": ServerConfig(), "recording": RecordingConfig(), "metrics": MetricsConfig()}
    )
    (folder / "cell").mkdir()
    file = unpack(pack(plain), folder / "cell")
    words = ["serve", str(file), "--port", "0", "--lockstep", ",".join(names), "--record", str(record)]
    process = _started(_armgate(words), folder / "daemon.log", subprocess.PIPE)
    try:
        yield _address(process, folder / "daemon.log")
    finally:
        _end(process, signal.SIGTERM)
    if process.returncode not in _ENDED:
        raise _failure("the daemon", process, folder / "daemon.log")


def _address(process: "subprocess.Popen[str]", log: Path) -> str:
    """Return the address that a daemon prints.

    Raises:
        CommandError: It ended before, or did not print one in time.
    """
    timer = threading.Timer(START_TIME, process.kill)
    timer.start()
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if found := LISTENING.match(line.rstrip("\n")):
                return found[1]
    finally:
        timer.cancel()
    process.wait()
    raise _failure("the daemon", process, log)


def _run(
    address: str,
    members: Mapping[str, Command | Controller],
    folder: Path,
    duration: float,
    until: Collection[str],
) -> None:
    started: dict[str, _Member] = {}
    with connect(address, name="campaign", role="observer") as cell:
        cell.subscribe(fields=())
        watch = _Watch(cell, duration)
        try:
            for name, member in members.items():
                started[name] = _start(name, member, address, folder)
            awaited = [started[name] for name in until or started]
            while not _all_ended(started.values(), awaited) and not watch.over.wait(_LOOK):
                pass
        finally:
            for one in started.values():
                one.stop()


class _Watch:
    """Thread that watches the virtual time; no state arrives while all controllers start or have ended.

    Args:
        cell: Connection with a subscription.
        duration: Duration of the trial, s.

    Attributes:
        over: Set when the duration is over, or the connection is lost.
    """

    def __init__(self, cell: Cell, duration: float) -> None:
        self.over = threading.Event()
        threading.Thread(target=self._follow, args=(cell, duration), name="watch", daemon=True).start()

    def _follow(self, cell: Cell, duration: float) -> None:
        with suppress(ClientError):
            for state in cell.states():
                if state.time >= duration:
                    break
        self.over.set()


def _all_ended(members: Collection[_Member], awaited: Sequence[_Member]) -> bool:
    for member in members:
        member.ended()  # raises if it failed
    return all(member.ended() for member in awaited)


def _start(name: str, member: Command | Controller, address: str, folder: Path) -> _Member:
    if isinstance(member, Controller):
        return _Thread(name, member, address)
    words = [word.replace("{address}", address).replace("{name}", name) for word in member.words]
    return _Process(name, words, member.robot, folder / f"{name}.log")


class _Process:
    """Command that runs as a process."""

    def __init__(self, name: str, words: Sequence[str], robot: str | None, log: Path) -> None:
        self.robot = robot
        self._name, self._log = name, log
        own = _armgate(words[1:]) if words[0] == "armgate" else _launched(words)
        self._process = _started(own, log, subprocess.DEVNULL)

    def ended(self) -> bool:
        """Return True if it has ended; raise `CommandError` if it failed."""
        status = self._process.poll()
        if status:
            raise _failure(self._name, self._process, self._log)
        return status == 0

    def stop(self) -> None:
        """End it, as Ctrl-C does."""
        _end(self._process, signal.SIGINT)


@dataclass
class _Requested:
    requested: bool = False


@dataclass
class _Thread:
    """Program that runs on a connection of its own, in a thread."""

    name: str
    controller: Controller
    address: str
    error: Exception | None = None
    asked: _Requested = field(default_factory=_Requested)

    def __post_init__(self) -> None:
        self.robot = self.controller.robot
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._thread.start()

    def ended(self) -> bool:
        """Return True if it has ended; raise its error if it failed."""
        if self.error is not None:
            raise CommandError(f"{self.name}: {self.error}") from self.error
        return not self._thread.is_alive()

    def stop(self) -> None:
        """Request its end, and wait for it."""
        self.asked.requested = True
        self._thread.join(END_TIME)

    def _run(self) -> None:
        try:
            with connect(self.address, name=self.name, patience=START_TIME) as cell:
                program = self.controller.make(ProgramContext(cell, self.robot, self.controller.seed))
                outcome = run(cell, self.robot, program, interrupt=self.asked)
            if outcome.failed:
                self.error = CommandError(outcome.text)
        except Exception as error:
            self.error = error


def _armgate(words: Sequence[str]) -> list[str]:
    """Return ``armgate WORDS`` as a command of this Python that ends with this process."""
    return [sys.executable, "-m", "armgate.apps.stack.child", str(os.getpid()), "0", *words]


def _launched(words: Sequence[str]) -> list[str]:
    """Return a command that ends with this process."""
    return [sys.executable, "-I", "-S", launch.__file__, str(os.getpid()), *words]


def _started(words: Sequence[str], log: Path, stdout: int) -> "subprocess.Popen[str]":
    with log.open("w", encoding="utf-8") as errors:
        return subprocess.Popen(  # noqa: S603  (the user names the commands)
            words, stdin=subprocess.DEVNULL, stdout=stdout, stderr=errors, text=True, start_new_session=True
        )


def _end(process: "subprocess.Popen[str]", signum: int) -> None:
    """End a process and its children: by a signal, then by force."""
    with suppress(ProcessLookupError):
        process.send_signal(signum)
    try:
        process.wait(END_TIME)
    except subprocess.TimeoutExpired:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _failure(name: str, process: "subprocess.Popen[str]", log: Path) -> CommandError:
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    last = next((line for line in reversed(lines) if line.strip()), "no output")
    return CommandError(f"{name} ended with status {process.returncode}: {last}")
