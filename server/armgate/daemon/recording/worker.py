"""Worker that writes a recording beside the event loop: a thread, or a task of a simulation."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Protocol


class Worker(Protocol):
    """Worker that takes all values of an iterator, and waits for each of these times, s."""

    def join(self, timeout: float) -> bool:
        """Wait for the end of the iterator; return False if it has not ended within ``timeout``, s."""


class ThreadWorker:
    """`Worker` that is a thread.

    Args:
        pauses: Does the work, and yields times to wait, s.
        pause: Waits for a number of seconds.
    """

    def __init__(self, pauses: Iterator[float], pause: Callable[[float], None] = time.sleep) -> None:
        self._pauses = pauses
        self._pause = pause
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def join(self, timeout: float) -> bool:
        """Wait for the end of the thread; return False if it has not ended within ``timeout``, s."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        for seconds in self._pauses:
            self._pause(seconds)
