"""Schedule: gives trials to a pool in batches, and repeats those whose worker ended."""

from collections import Counter, deque
from collections.abc import Callable, Sequence

from armgate.campaign.pool import Finished, Pool
from armgate.campaign.result import Result, worker_ended
from armgate.campaign.trials import Trial

BATCH_TIME = 1.0
"""Time that a batch should take, s: long against the cost of a message, short against that of its loss."""
LARGEST = 64
"""Largest number of trials in a batch."""
AHEAD = 2
"""Batches that wait or run for each worker."""
_SHARE = 0.2
"""Weight of the newest batch in the mean time of a trial."""


class Schedule:
    """Schedule of the trials of a campaign.

    Args:
        pool: The workers.
        take: Receives each result, once.
        attempts: Attempts of a trial whose worker ends.
        timeout: Longest time of a trial, s; named in the reason of a failed trial.
    """

    def __init__(self, pool: Pool, take: Callable[[Result], None], attempts: int, timeout: float) -> None:
        self._pool, self._take = pool, take
        self._attempts, self._timeout = attempts, timeout
        self._todo: deque[Trial] = deque()
        self._suspects: deque[Trial] = deque()
        self._alone = False
        self._ended: Counter[str] = Counter()
        self._running = 0
        self._seconds: float | None = None

    def run(self, trials: Sequence[Trial]) -> None:
        """Run trials until each has a result."""
        self._todo.extend(trials)
        self._fill()
        while self._running:
            finished = self._pool.wait()
            self._running -= 1
            for result in finished.results:
                self._take(result)
            self._measure(finished)
            self._repeat(finished)
            self._fill()

    def _fill(self) -> None:
        """Submit batches; at last, submit each suspect while no other trial waits or runs."""
        while self._todo and self._running < AHEAD * self._pool.workers:
            self._submit([self._todo.popleft() for _ in range(min(self._size(), len(self._todo)))])
        self._alone = not self._running and bool(self._suspects)
        if self._alone:
            self._submit([self._suspects.popleft()])

    def _submit(self, batch: Sequence[Trial]) -> None:
        self._pool.submit(batch)
        self._running += 1

    def _size(self) -> int:
        """Return the size of the next batch: for a time, and smaller near the end of the campaign."""
        if self._seconds is None:
            return 1
        fair = len(self._todo) // (AHEAD * self._pool.workers)
        return max(1, min(int(BATCH_TIME / max(self._seconds, 1e-6)), fair, LARGEST))

    def _measure(self, finished: Finished) -> None:
        if finished.results:
            each = finished.seconds / len(finished.results)
            known = each if self._seconds is None else self._seconds
            self._seconds = (1.0 - _SHARE) * known + _SHARE * each

    def _repeat(self, finished: Finished) -> None:
        for trial in finished.suspects:
            self._ended[trial.key] += finished.exact or self._alone
            if self._ended[trial.key] >= self._attempts:
                self._take(worker_ended(trial.key, self._timeout))
            else:
                self._suspects.append(trial)
        self._todo.extendleft(reversed(finished.lost))
