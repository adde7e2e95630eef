"""Worker: runs batches of trials in a process of a pool."""

import os
import pickle
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache

from armgate.campaign.errors import CampaignError
from armgate.campaign.pool import Lab, Plan
from armgate.campaign.result import Result, failed
from armgate.campaign.trials import Trial

TIMED_OUT = 3
"""Exit status of a worker whose trial exceeded the timeout."""


def packed(plan: Plan) -> bytes:
    """Return a plan as bytes for workers."""
    return pickle.dumps(plan)


@lru_cache(maxsize=2)
def _laboratory(plan: bytes) -> tuple[Plan, Lab]:
    found: Plan = pickle.loads(plan)  # noqa: S301  (from the driver, which also sends the code to run)
    return found, found.laboratory()


def run_trials(plan: bytes, trials: Sequence[Trial]) -> Iterator[Result]:
    """Run trials one after the other.

    A trial that exceeds the timeout ends this process, because Python code cannot be interrupted safely.

    Raises:
        WorkerError: This machine has other software or files.
    """
    found, laboratory = _laboratory(plan)
    for trial in trials:
        with _time_limit(found.timeout):
            result = _run(laboratory, trial)
        yield result


def _run(laboratory: Lab, trial: Trial) -> Result:
    """Run a trial; anything that a controller raises, such as SystemExit, fails only the trial."""
    try:
        return laboratory.run(trial)
    except CampaignError:
        raise
    except BaseException as error:
        return failed(trial.key, error)


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    timer = threading.Timer(seconds, os._exit, (TIMED_OUT,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def run_batch(plan: bytes, trials: Sequence[Trial]) -> tuple[list[Result], float]:
    """Run trials; return their results and the time that they took, s."""
    begin = time.monotonic()
    return list(run_trials(plan, trials)), time.monotonic() - begin
