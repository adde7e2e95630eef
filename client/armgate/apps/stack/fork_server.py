"""Children that are forked from one process with all libraries loaded: for many short runs in a row.

A child runs ``armgate COMMAND`` in a process of its own, and starts in milliseconds instead of seconds.
Works on Linux and macOS.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import IO

from armgate.apps.stack.child import end_with, run_command, set_priority

PRELOADED = "armgate.apps.stack.preload"


class ForkServer:
    """Fork server; its first child waits until the libraries are loaded."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([PRELOADED])

    def warm(self) -> None:
        """Wait until the libraries are loaded; after an installation this includes compiling."""
        child = self._context.Process(target=_nothing)
        child.start()
        child.join()

    def start(self, arguments: Sequence[str], log: Path, *, priority: int) -> "Fork":
        """Start ``armgate ARGUMENTS`` with its stdout piped here and its stderr appended to a file."""
        ours, theirs = self._context.Pipe(duplex=False)
        child = self._context.Process(
            target=_run_child, args=(list(arguments), log, theirs, priority), name=arguments[0], daemon=True
        )
        child.start()
        theirs.close()
        return Fork(child, ours)


class Fork:
    """Forked child with the interface of ``subprocess.Popen``."""

    def __init__(self, process: BaseProcess, stdout: Connection) -> None:
        self._process = process
        self._pipe = stdout
        self._ended = threading.Event()
        self._status = 0
        self.stdout: IO[str] = open(os.dup(stdout.fileno()), encoding="utf-8", errors="replace")  # noqa: SIM115
        stdout.close()

    def poll(self) -> int | None:
        """Return the exit status; None while the child runs."""
        return self._status if self._ended.is_set() else None

    def wait(self) -> int:
        """Wait for the child's end and return its exit status; to be called by its waiter thread only."""
        self._process.join()
        self._status = self._process.exitcode or 0
        self._ended.set()
        return self._status

    def send_signal(self, signum: int) -> None:
        """Send a signal to the child unless it has ended."""
        if self.poll() is None and self._process.pid is not None:
            with suppress(ProcessLookupError):
                os.kill(self._process.pid, signum)

    def kill(self) -> None:
        """Kill the child."""
        self.send_signal(signal.SIGKILL)


def _nothing() -> None:
    """Do nothing: the start of a child waits until everything is loaded."""


def _run_child(arguments: list[str], log: Path, stdout: Connection, priority: int) -> None:
    """Run a command in the child."""
    os.setpgid(0, 0)
    end_with(os.getppid())  # the fork server ends with the process that started it
    os.dup2(stdout.fileno(), 1)
    stdout.close()
    errors = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(errors, 2)
    os.close(errors)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    set_priority(priority)
    run_command(arguments)
