"""Flight recorder of a lock-step run, which writes between two turns of the event loop, without a thread.

There is time to write while the participants compute. A thread would block the interpreter when the event
loop has to answer. No record is lost if the disk is slow, because the run waits for the disk.

The records of a few steps are encoded together: the second record takes a third of the time of the first,
because the code is in the processor's caches then. More steps would delay the next state.
"""

import asyncio

from armgate.daemon.recording.recorder import Recorder
from armgate.recorder.parts import StateAt
from armgate.recording import Item

_TOGETHER = 32
"""Records that are encoded together; a step of two robots has nine."""


class InlineRecorder(Recorder):
    """`Recorder` that runs in one event loop, without a thread."""

    _loop: asyncio.AbstractEventLoop
    _due = False
    _flushing: asyncio.TimerHandle | None = None

    def close(self, timeout: float = 10.0) -> None:
        """Write the waiting records and close the file; ``timeout`` is not used."""
        if self._begun:
            self._catch_up()
            self._begun = False
        if self._flushing is not None:
            self._flushing.cancel()
            self._flushing = None
        if self._failure is None:
            with self._guard():
                self._parts.close()

    def _start(self) -> None:
        self._loop = asyncio.get_running_loop()

    def _put(self, at: float, item: Item | StateAt) -> None:
        if self._failure is not None:
            self._lost += 1
            return
        self._queue.append((at, item))
        if len(self._queue) >= self._limit:
            self._catch_up()
        elif len(self._queue) >= _TOGETHER and not self._due:
            self._due = True
            self._loop.call_soon(self._catch_up)
        if self._flushing is None:
            self._flushing = self._loop.call_later(self._flush, self._flush_on)

    def _catch_up(self) -> None:
        self._due = False
        if self._failure is None:
            with self._guard():
                self._write_all()

    def _write_all(self) -> None:
        while self._queue and (queued := self._queue.popleft()) is not None:
            self._parts.put(*queued)

    def _flush_on(self) -> None:
        self._flushing = None
        if self._failure is None:
            with self._guard():
                self._write_all()
                self._parts.flush()
