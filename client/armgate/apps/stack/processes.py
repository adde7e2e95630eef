"""Child processes: started, watched by events, ended in order, never left running."""

import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from armgate.apps.stack.fork_server import Fork, ForkServer

TAIL = 12
"""Number of log lines that are shown of a child that failed."""
_SINGLE_THREADED = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def armgate(*arguments: str, priority: int) -> list[str]:
    """Return the command line of a child that ends with this process."""
    return [sys.executable, "-m", "armgate.apps.stack.child", str(os.getpid()), str(priority), *arguments]


@dataclass(frozen=True)
class Printed:
    """Line that a child wrote on its stdout."""

    name: str
    text: str


@dataclass(frozen=True)
class Exited:
    """End of a child; a negative status is the signal that killed it."""

    name: str
    status: int


@dataclass(frozen=True)
class Interrupted:
    """Request of the user or the system to end this process."""

    signum: int


Event = Printed | Exited | Interrupted


Child = subprocess.Popen[str] | Fork
"""Child process, started as a program or forked."""


class Children:
    """Children of one run, with one queue of their events.

    Each child has a process group of its own: a Ctrl-C in the terminal reaches only this process, which then
    ends the children in the right order. Leaving the context kills the children that still run.

    Args:
        logs: Folder of the children's logs.
        fork_server: Server to fork them from; None to start each child as a separate program.
    """

    def __init__(self, logs: Path, fork_server: ForkServer | None = None) -> None:
        self.events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._logs = logs
        self._fork_server = fork_server
        self._children: dict[str, Child] = {}
        self._waiters: dict[str, threading.Thread] = {}

    def __enter__(self) -> "Children":
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children.values():
            if child.poll() is None:
                child.kill()
        for waiter in self._waiters.values():
            waiter.join()

    def launch(self, name: str, arguments: Sequence[str], *, priority: int) -> None:
        """Start ``armgate ARGUMENTS`` as a child; priority 0 means an ordinary process."""
        if self._fork_server is None:
            self.start(name, armgate(*arguments, priority=priority))
        else:
            self._begin_log(name)
            self._adopt(name, self._fork_server.start(arguments, self.log(name), priority=priority))

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start a child; its stdout becomes events and, like its stderr, goes into its log."""
        self._begin_log(name)
        with self.log(name).open("a", encoding="utf-8") as log:
            child = subprocess.Popen(  # noqa: S603
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                process_group=0,
                # Matrices are small here: threads of the linear algebra library would only occupy the cores.
                env={**os.environ, **_SINGLE_THREADED},
            )
        self._adopt(name, child)

    def _adopt(self, name: str, child: Child) -> None:
        self._children[name] = child
        waiter = threading.Thread(target=self._watch, args=(name, child), name=f"watch {name}", daemon=True)
        waiter.start()
        self._waiters[name] = waiter

    def _begin_log(self, name: str) -> None:
        """Create an empty log that only this user can read: the viewer's log holds the token of its page."""
        self.log(name).unlink(missing_ok=True)
        os.close(os.open(self.log(name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))

    def log(self, name: str) -> Path:
        """Return the log file of a child."""
        return self._logs / f"{name}.log"

    def tail(self, name: str) -> list[str]:
        """Return the last lines of a child's log."""
        return self.log(name).read_text(encoding="utf-8", errors="replace").splitlines()[-TAIL:]

    def running(self, *names: str) -> list[str]:
        """Return the named children (default: all) whose end is not yet among the events."""
        # A waiter thread ends after it has queued its child's end. The child itself ends a moment earlier:
        # checking the child could find it ended while no event explains how.
        return [n for n, waiter in self._waiters.items() if (not names or n in names) and waiter.is_alive()]

    def send(self, signum: signal.Signals, *names: str) -> None:
        """Send a signal to the named children that still run."""
        for name in self.running(*names):
            self._children[name].send_signal(signum)

    def next(self, timeout: float) -> Event | None:
        """Return the next event; None after the timeout."""
        try:
            return self.events.get(timeout=timeout)
        except queue.Empty:
            return None

    def wait(self, names: Sequence[str], timeout: float) -> list[str]:
        """Wait until the named children have ended and their ends are queued; return those still running."""
        for name in self.running(*names):
            self._waiters[name].join(timeout)
        return self.running(*names)

    def _watch(self, name: str, child: Child) -> None:
        stdout: IO[str] | None = child.stdout
        assert stdout is not None
        with stdout, self.log(name).open("a", encoding="utf-8") as log:
            for line in stdout:
                log.write(line)
                log.flush()
                self.events.put(Printed(name, line.rstrip("\n")))
        self.events.put(Exited(name, child.wait()))
