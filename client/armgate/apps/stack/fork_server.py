"""Children that are forked from one process which has the libraries loaded: for many short runs in a row.

A child is a process of its own with everything that ``armgate COMMAND`` has, started in some milliseconds
instead of seconds. Linux and macOS.
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

from armgate.apps.stack.child import end_with, hurry, live

PRELOADED = "armgate.apps.stack.preload"


class ForkServer:
    """Starts children; the first one waits until the libraries are loaded."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([PRELOADED])

    def warm(self) -> None:
        """Waits until the libraries are loaded; after an installation parts are compiled first."""
        child = self._context.Process(target=_nothing)
        child.start()
        child.join()

    def start(self, arguments: Sequence[str], log: Path, *, priority: int) -> "Fork":
        """Starts ``armgate ARGUMENTS``, its stdout piped to here and its stderr appended to a file."""
        ours, theirs = self._context.Pipe(duplex=False)
        child = self._context.Process(
            target=_live, args=(list(arguments), log, theirs, priority), name=arguments[0], daemon=True
        )
        child.start()
        theirs.close()
        return Fork(child, ours)


class Fork:
    """Forked child, used like a ``subprocess.Popen``."""

    def __init__(self, process: BaseProcess, stdout: Connection) -> None:
        self._process = process
        self._pipe = stdout
        self._ended = threading.Event()
        self._status = 0
        self.stdout: IO[str] = open(os.dup(stdout.fileno()), encoding="utf-8", errors="replace")  # noqa: SIM115
        stdout.close()

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""
        return self._status if self._ended.is_set() else None

    def wait(self) -> int:
        """Wait for its end and return its exit status; for the one thread that watches it."""
        self._process.join()
        self._status = self._process.exitcode or 0
        self._ended.set()
        return self._status

    def send_signal(self, signum: int) -> None:
        """Sends it a signal, unless it has ended."""
        if self.poll() is None and self._process.pid is not None:
            with suppress(ProcessLookupError):
                os.kill(self._process.pid, signum)

    def kill(self) -> None:
        """Ends it at once."""
        self.send_signal(signal.SIGKILL)


def _nothing() -> None:
    """What a child does that only shows that all is loaded."""


def _live(arguments: list[str], log: Path, stdout: Connection, priority: int) -> None:
    """What the child does."""
    os.setpgid(0, 0)
    end_with(os.getppid())  # that ends when the process does that asked for this one
    os.dup2(stdout.fileno(), 1)
    stdout.close()
    errors = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(errors, 2)
    os.close(errors)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    hurry(priority)
    live(arguments)
