"""Schedule: batches, repetitions, attempts; with a pool that ends workers by plan."""

from collections import Counter, deque
from collections.abc import Sequence

import pytest

from armgate.campaign.pool import Finished
from armgate.campaign.result import Result
from armgate.campaign.schedule import AHEAD, LARGEST, Schedule
from armgate.campaign.trials import Trial

TRIALS = [Trial(f"{k:016x}", "s", "c", k, ()) for k in range(200)]


class Pool:
    """Pool whose workers end during some trials, for some of their runs."""

    def __init__(self, deadly: dict[int, int], *, streams: bool, seconds: float = 0.01) -> None:
        self.workers = 2
        self.batches: list[int] = []
        self.most = 0
        self.runs: Counter[int] = Counter()
        self._deadly, self._streams, self._seconds = deadly, streams, seconds
        self._waiting: deque[Sequence[Trial]] = deque()

    def submit(self, batch: Sequence[Trial]) -> None:
        self._waiting.append(batch)
        self.batches.append(len(batch))
        self.most = max(self.most, len(self._waiting))

    def wait(self) -> Finished:
        batch = self._waiting.popleft()
        results = []
        for at, trial in enumerate(batch):
            self.runs[trial.seed] += 1
            if self.runs[trial.seed] <= self._deadly.get(trial.seed, 0):
                if self._streams:
                    return Finished(results, batch[at : at + 1], True, batch[at + 1 :])
                return Finished([], batch)
            results.append(Result(trial.key))
        return Finished(results, seconds=self._seconds * len(batch))

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *_: object) -> None: ...


@pytest.mark.parametrize("attempts", [1, 3])
@pytest.mark.parametrize("streams", [True, False])
def test_every_trial_has_one_result_whatever_ends(streams: bool, attempts: int) -> None:
    deadly = {50: 99, 120: 99, 199: 99} | ({3: 2, 121: 1} if attempts > 1 else {})
    pool = Pool(deadly, streams=streams)
    results: list[Result] = []
    Schedule(pool, results.append, attempts=attempts, timeout=9.0).run(TRIALS)
    assert Counter(result.key for result in results) == Counter(trial.key for trial in TRIALS)
    failed = [int(result.key, 16) for result in results if result.failed]
    assert sorted(failed) == [50, 120, 199]
    runs = {pool.runs[seed] for seed in failed}
    assert (
        runs == {attempts} if streams else runs <= {attempts, attempts + 1}
    )  # a death in a batch suspects all of it, and counts for none
    (reason,) = {result.reason for result in results if result.failed}
    assert reason == "its worker process ended at every attempt, or the timeout of 9 s passed"


def test_batches_grow_to_a_second_and_shrink_at_the_end() -> None:
    pool = Pool({}, streams=True, seconds=0.05)
    Schedule(pool, lambda _: None, attempts=3, timeout=9.0).run(TRIALS)
    assert pool.batches[0] == pool.batches[-1] == 1
    assert 15 <= max(pool.batches) <= 20
    assert pool.most <= AHEAD * pool.workers


def test_long_trials_stay_alone_and_short_ones_are_bounded() -> None:
    for seconds, largest in ((3.0, 1), (1e-6, min(LARGEST, 200 // (2 * AHEAD)))):
        pool = Pool({}, streams=True, seconds=seconds)
        Schedule(pool, lambda _: None, attempts=3, timeout=9.0).run(TRIALS)
        assert largest // 2 <= max(pool.batches) <= largest


def test_no_trials_need_no_worker() -> None:
    pool = Pool({}, streams=True)
    Schedule(pool, lambda _: None, attempts=1, timeout=1.0).run([])
    assert pool.batches == []
