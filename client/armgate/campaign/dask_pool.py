"""Pool of the workers of a Dask cluster: one that runs already, or one on this machine.

Dask keeps results in its workers and the list of tasks in its scheduler, and loses both with the scheduler.
So the driver stores each batch as soon as it ends, and the campaign is resumed from the store.
"""

import importlib
import logging
import queue
import re
import time
from collections.abc import Sequence
from typing import Any
from uuid import uuid4

from armgate.campaign.errors import CampaignError, UsageError
from armgate.campaign.local_pool import PRELOADED
from armgate.campaign.pool import Finished, Plan
from armgate.campaign.result import Result
from armgate.campaign.trials import Trial
from armgate.campaign.worker import packed, run_batch

ADDRESS = re.compile(r"(tcp|tls|ws|wss)://[^/\s]+:\d{1,5}")
"""Address of a scheduler."""
CONNECT_TIME = 10.0
"""Timeout for the scheduler and its first worker, s."""
LOST_TIME = 5.0
"""Time without connection to the scheduler after which it counts as lost, s."""
COUNT_TIME = 2.0
"""Period in which the workers are counted, s."""
_LOOK = 0.5
"""Period in which the connection is checked, s."""


class DaskPool:
    """Workers of a Dask cluster.

    Args:
        plan: Input of the workers.
        scheduler: Address of the scheduler; None: a cluster on this machine.
        workers: Number of workers of the cluster on this machine.

    Raises:
        UsageError: The address of the scheduler is not one.
        CampaignError: The scheduler does not answer, or has no workers.
    """

    def __init__(self, plan: Plan, scheduler: str | None, workers: int | None) -> None:
        if scheduler is not None and ADDRESS.fullmatch(scheduler) is None:
            raise UsageError(f"--scheduler {scheduler}: expected an address such as tcp://host:8786")
        _silence()
        self._plan = packed(plan)
        self._address = scheduler
        self._cluster = None if scheduler is not None else _local_cluster(workers or 1)
        self._client = self._connect()
        self._workers, self._counted = 1, -COUNT_TIME
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._batches: dict[str, Sequence[Trial]] = {}
        self._futures: dict[str, Any] = {}
        self._run = uuid4().hex

    @property
    def workers(self) -> int:
        """Number of threads of all workers, some seconds old; it grows when workers join."""
        now = time.monotonic()
        if self._connected and now >= self._counted + COUNT_TIME:
            self._workers, self._counted = max(1, sum(self._client.nthreads().values())), now
        return self._workers

    def submit(self, batch: Sequence[Trial]) -> None:
        """Give a batch to the workers."""
        key = f"campaign-{self._run}-{uuid4().hex}"
        self._batches[key] = batch
        future = self._client.submit(run_batch, self._plan, list(batch), key=key, pure=False)
        self._futures[key] = future
        future.add_done_callback(self._ended.put)

    def wait(self) -> Finished:
        """Wait for the next end of a batch.

        Raises:
            CampaignError: The scheduler is lost, or a worker cannot run trials.
        """
        future = self._next()
        batch = self._batches.pop(future.key)
        del self._futures[future.key]
        if future.status == "finished":
            results, seconds = self._fetched(future)
            return Finished(results, seconds=seconds)
        if future.status == "error":
            return self._failed(batch, future.exception())
        raise self._lost()

    def __enter__(self) -> "DaskPool":
        return self

    def __exit__(self, *_: object) -> None:
        if self._connected:
            self._client.cancel(list(self._futures.values()))
        self._client.close(timeout=1.0)
        if self._cluster is not None:
            self._cluster.close()

    @property
    def _connected(self) -> bool:
        return bool(self._client.status == "running")

    def _connect(self) -> Any:
        from distributed import Client

        where = self._cluster or self._address
        try:
            client = Client(  # type: ignore[no-untyped-call]
                where, timeout=CONNECT_TIME, set_as_default=False
            )
            client.wait_for_workers(1, timeout=CONNECT_TIME)
        except (OSError, TimeoutError, ValueError) as error:
            raise CampaignError(
                f"{self._address}: no Dask scheduler with workers answers ({error}); start them with "
                "'dask scheduler' and 'dask worker ADDRESS --nthreads 1'"
            ) from error
        return client

    def _next(self) -> Any:
        since = time.monotonic()
        while True:
            try:
                return self._ended.get(timeout=_LOOK)
            except queue.Empty:
                if self._connected:
                    since = time.monotonic()
                elif time.monotonic() - since > LOST_TIME:
                    raise self._lost() from None

    def _fetched(self, future: Any) -> tuple[Sequence[Result], float]:
        """Return the results of a batch, which Dask keeps in the worker until now."""
        from distributed import CancelledError

        try:
            fetched: tuple[Sequence[Result], float] = future.result()
        except (OSError, CancelledError) as error:
            raise self._lost() from error
        return fetched

    def _failed(self, batch: Sequence[Trial], error: Exception) -> Finished:
        from distributed.scheduler import KilledWorker

        if isinstance(error, KilledWorker):
            return Finished([], batch)
        if isinstance(error, CampaignError):
            raise error
        raise CampaignError(f"a worker failed: {type(error).__name__}: {error}") from error

    def _lost(self) -> CampaignError:
        return CampaignError(
            f"the Dask scheduler {self._address or 'of this machine'} is lost; start it and its workers, and "
            "run the same command again to continue"
        )


def _silence() -> None:
    """Switch off the log of Dask, after its import has set its levels: the driver reports lost workers."""
    importlib.import_module("distributed")
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _local_cluster(workers: int) -> Any:
    import dask
    from distributed import LocalCluster

    importlib.import_module(PRELOADED)  # compiles kernels, which takes long once, with a notice
    # The schedule of the campaign repeats a trial that ended its worker, alone and a stated number of times.
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    return LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    )
