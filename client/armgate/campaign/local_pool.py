"""Pool of processes on this machine, made by a fork server.

Plain forks of the driver would hang if it ever ran a parallel kernel of numba, so the workers are forked from
a process that has only loaded the libraries. Each worker sends its results one by one: if it ends, only the
trial that it was running is suspected.
"""

import multiprocessing
import signal
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from tempfile import TemporaryDirectory
from typing import Any

from armgate.campaign.errors import CampaignError
from armgate.campaign.pool import Finished, Plan
from armgate.campaign.result import Result
from armgate.campaign.trials import Trial
from armgate.campaign.worker import packed, run_trials

PRELOADED = "armgate.campaign.preload"
_DONE = None
"""Message of a worker that has finished a batch."""


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    batch: list[Trial] = field(default_factory=list)
    results: list[Result] = field(default_factory=list)
    since: float = 0.0


class LocalPool:
    """Pool of worker processes on this machine.

    Args:
        plan: Input of the workers.
        workers: Number of workers.
    """

    def __init__(self, plan: Plan, workers: int) -> None:
        self._plan = packed(plan)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([PRELOADED])
        self._folder = TemporaryDirectory(prefix="armgate-campaign-")
        self._queue: deque[Sequence[Trial]] = deque()
        self._workers: list[_Worker] = []
        try:
            for _ in range(workers):
                self._workers.append(self._start())
        except BaseException:
            self.__exit__()
            raise

    @property
    def workers(self) -> int:
        """Number of workers."""
        return len(self._workers)

    @property
    def processes(self) -> list[int]:
        """Ids of the worker processes."""
        return [worker.process.pid for worker in self._workers if worker.process.pid is not None]

    def submit(self, batch: Sequence[Trial]) -> None:
        """Give a batch to the workers."""
        self._queue.append(batch)
        self._hand_out()

    def wait(self) -> Finished:
        """Wait for the next end of a batch."""
        while True:
            self._hand_out()
            busy = {worker.pipe: worker for worker in self._workers if worker.batch}
            for pipe in wait(list(busy)):
                finished = self._receive(busy[pipe])  # type: ignore[index]
                if finished is not None:
                    return finished

    def __enter__(self) -> "LocalPool":
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.pipe.close()
        self._folder.cleanup()

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_work, args=(theirs, self._plan, self._folder.name), name="campaign worker", daemon=True
        )
        with _held_interrupts():
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def _hand_out(self) -> None:
        for worker in list(self._workers):
            if not worker.batch and self._queue:
                self._give(worker, self._queue.popleft())

    def _give(self, worker: _Worker, batch: Sequence[Trial]) -> None:
        try:
            worker.pipe.send(batch)
        except OSError:  # it was ended while it had nothing to do
            worker = self._renew(worker)
            worker.pipe.send(batch)
        worker.batch, worker.since = list(batch), time.monotonic()

    def _receive(self, worker: _Worker) -> Finished | None:
        try:
            message = worker.pipe.recv()
        except (EOFError, OSError):
            return self._replace(worker)
        if isinstance(message, Result):
            worker.results.append(message)
            return None
        if isinstance(message, CampaignError):
            raise message
        assert message is _DONE
        return _end(worker, [])

    def _replace(self, worker: _Worker) -> Finished:
        self._renew(worker)
        return _end(worker, worker.batch[len(worker.results) :])

    def _renew(self, worker: _Worker) -> _Worker:
        """Replace a worker that has ended by a new one."""
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()
        started = self._start()
        self._workers[self._workers.index(worker)] = started
        return started


def _end(worker: _Worker, left: list[Trial]) -> Finished:
    finished = Finished(worker.results, left[:1], True, left[1:], time.monotonic() - worker.since)
    worker.batch, worker.results = [], []
    return finished


@contextmanager
def _held_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back: a fork server that starts would print a traceback. Its processes inherit this."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Any, plan: bytes, folder: str) -> None:
    """Run batches until the driver closes the pipe or ends.

    Args:
        pipe: Receives batches, and sends results.
        plan: Input of the worker.
        folder: Folder of temporary files; the driver removes it, because workers are killed.
    """
    tempfile.tempdir = folder
    # Ctrl-C reaches all processes; the driver ends the workers. Unlike SIG_IGN, commands do not inherit this.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        while True:
            trials = pipe.recv()
            try:
                for result in run_trials(plan, trials):
                    pipe.send(result)
            except CampaignError as error:
                pipe.send(error)
            except Exception as error:
                pipe.send(CampaignError(f"a worker failed: {type(error).__name__}: {error}"))
            else:
                pipe.send(_DONE)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
