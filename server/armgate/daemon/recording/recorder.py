"""The flight recorder: events, outputs and states go into a queue, and a thread writes them.

The event loop only puts immutable values into the queue, so a slow or full disk delays no tick. Records
that do not fit into the queue are lost. They are counted, marked in the recording, and reported in the
states.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from armgate.daemon.recording.worker import ThreadWorker, Worker
from armgate.events import GateEvent, GateOutput
from armgate.recorder.parts import ROTATE, Parts, StateAt, state_at
from armgate.recorder.record_file import RecordFile
from armgate.recording import Gap, Header, Item, LogLine, Step
from armgate.recording.chain import Seal, Signer
from armgate.world.states import Snapshot

FLUSH = 0.12
"""Longest time of a run that is lost if the daemon is killed, s, in addition to the backlog of the worker."""

_POLL = 0.02
"""Time between two polls of the queue by the thread, s: each wake-up costs time of the event loop."""


_Queued = tuple[float, Item | StateAt] | None


class Recorder:
    """Recorder of one run of a daemon.

    Args:
        folder: Folder of the files; created if it does not exist.
        required: True if the robots must be stopped as soon as a record is lost.
        rotate: Size of a file after which the next file begins, bytes.
        limit: Records that may wait for the disk.
        flush: Longest time between two flushes, s.
        signer: Signs each file when it is closed; None: files are not signed.
        create: Creates a file, from its path, header and signer.
        clock: Monotonic clock of the worker, s.
        worker: Makes the worker that writes, from the iterator that does the work.

    Attributes:
        folder: Folder of the files.
        required: As the argument.
    """

    def __init__(
        self,
        folder: Path,
        *,
        required: bool = False,
        rotate: int = ROTATE,
        limit: int = 16384,
        flush: float = FLUSH,
        signer: Signer | None = None,
        create: Callable[[Path, Header, Signer | None], RecordFile] = RecordFile.create,
        clock: Callable[[], float] = time.monotonic,
        worker: Callable[[Iterator[float]], Worker] = ThreadWorker,
    ) -> None:
        self.folder = folder
        self.required = required
        self._parts = Parts(folder, rotate, signer, create)
        self._limit = limit
        self._flush = flush
        self._clock, self._make_worker = clock, worker
        self._queue: deque[_Queued] = deque()
        self._lost = 0
        self._pending = Gap(0, 0)
        self._failure: str | None = None
        self._now: Callable[[], float] = lambda: 0.0
        self._begun = self._ended = False
        self._worker: Worker | None = None

    def begin(self, header: Header, now: Callable[[], float]) -> None:
        """Create the first file and begin to write.

        Args:
            header: Header of the recording.
            now: Daemon time, s.

        Raises:
            OSError: The folder or the file cannot be created.
        """
        self._now = now
        self._parts.begin(header)
        self._begun = True
        self._start()

    def _start(self) -> None:
        self._worker = self._make_worker(self._write())

    # --- from the event loop ------------------------------------------------------------------------------

    @property
    def seal(self) -> Seal | None:
        """End of the hash chain of the file that was closed last."""
        return self._parts.seal

    @property
    def ended_early(self) -> bool:
        """True if writing has failed: since then nothing is recorded."""
        return self._failure is not None

    @property
    def trouble(self) -> str | None:
        """Warning for the states about missing records; None if the recording is complete."""
        if self._failure is not None:
            return f"recording ended: {self._failure}"
        if self._lost:
            return f"recording has gaps: {self._lost} records were lost because the disk is too slow"
        return None

    @property
    def depth(self) -> int:
        """Number of records that wait to be written."""
        return len(self._queue)

    @property
    def lost(self) -> int:
        """Number of records that were lost."""
        return self._lost

    def tap(self, event: GateEvent, outputs: Sequence[GateOutput]) -> None:
        """Record an event and the gate's outputs."""
        self._put(self._now(), Step(event, outputs))

    def show(self, snapshot: Snapshot) -> None:
        """Record the states of an instant."""
        state = state_at(snapshot)
        if state is not None:
            self._put(state.cell.time, state)

    def log(self, record: Mapping[str, Any]) -> None:
        """Record a line of the log."""
        if self._begun:
            fields = {key: value for key, value in record.items() if key not in ("time", "level", "event")}
            line = LogLine(record["time"], record["level"], record["event"], fields)
            self._put(self._now(), line)

    def close(self, timeout: float = 10.0) -> None:
        """Write the waiting records and close the file; wait for at most ``timeout`` s."""
        if self._worker is not None:
            self._queue.append(None)
            if not self._worker.join(timeout):
                self._failure = f"{self._parts.path}: not written within {timeout:g} s"
            self._worker = None

    def _put(self, at: float, item: Item | StateAt) -> None:
        if len(self._queue) >= self._limit:
            self._lose(item)
            return
        if self._pending.records:
            self._queue.append((at, self._pending))
            self._pending = Gap(0, 0)
        self._queue.append((at, item))

    def _lose(self, item: object) -> None:
        self._lost += 1
        step = isinstance(item, Step)
        self._pending = Gap(self._pending.records + 1, self._pending.steps + step)

    # --- in the worker: each value yielded is a time to wait, s -------------------------------------------

    def _write(self) -> Iterator[float]:
        with self._guard():
            yield from self._write_on()
        while not self._ended:  # writing has failed: count the records
            if not self._queue:
                yield _POLL
            elif self._queue.popleft() is None:
                return
            else:
                self._lost += 1

    def _write_on(self) -> Iterator[float]:
        due = self._clock() + self._flush
        while True:
            if not self._queue:
                yield _POLL
            elif (queued := self._queue.popleft()) is None:
                self._ended = True
                self._parts.close()
                return
            else:
                self._parts.put(*queued)
                yield 0.0  # the event loop may wait for the interpreter: let it run first
            if self._clock() >= due:
                self._parts.flush()
                due = self._clock() + self._flush

    # --- the file -----------------------------------------------------------------------------------------

    @contextmanager
    def _guard(self) -> Iterator[None]:
        """Do some work; if that fails, the recording has ended."""
        try:
            yield
        except OSError as error:
            self._fail(error.strerror or str(error))
        except Exception as error:
            self._fail(repr(error))

    def _fail(self, why: str) -> None:
        self._parts.abandon()
        self._failure = f"{self._parts.path}: {why}"
