"""Campaign of short trials on a local Dask cluster: two workers against one, and losses in the middle.

The campaign is the one in ``configs/campaigns/swing.yaml`` with short trials. The rate counts from the first
result, so that it does not contain the start of the workers. In the last part, a worker is killed after a
third of the trials and the scheduler after two thirds; then the campaign is resumed with a new cluster.

    bench_campaign.py [TRIALS]
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from report import Row, report

from armgate.campaign.dask_pool import DaskPool
from armgate.campaign.drive import Campaign, run_campaign
from armgate.campaign.errors import CampaignError
from armgate.campaign.local_pool import LocalPool
from armgate.campaign.pool import Finished, Pool
from armgate.campaign.store import read_results

TRIALS = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
GOAL = 1.8
"""Goal for the rate of two workers against that of one."""
SHARE = 5
"""One worker runs one trial in this many."""

ROOT = Path(__file__).parents[1]
TEXT = """armgate: 1
name: bench
cell: [{planar}]
duration: 0.4 s
seeds: {seeds}
controllers:
  swing:
    P: {{program: "armgate.campaign.motions:swing", options: {{joint: 0, amplitude: 0.7}}}}
vary:
  cell.robots.P.link.lag: {{uniform: [0 ms, 60 ms]}}
  controllers.P.options.time: {{log_uniform: [1.8 s, 4 s]}}
"""


def campaign(folder: Path, trials: int) -> Campaign:
    """Return a campaign of some trials."""
    file = folder / f"bench-{trials}.yaml"
    file.write_text(TEXT.format(planar=ROOT / "configs" / "planar.yaml", seeds=trials), encoding="utf-8")
    return Campaign.load(file)


class Cluster:
    """Scheduler and workers as processes."""

    def __init__(self, port: int, workers: int) -> None:
        self.address = f"tcp://127.0.0.1:{port}"
        options = ("--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
        self.scheduler = _dask("scheduler", *options)
        self.workers = [
            _dask("worker", self.address, "--nthreads", "1", "--no-dashboard") for _ in range(workers)
        ]

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        for process in (*self.workers, self.scheduler):
            kill(process)


def _dask(part: str, *options: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{part}", *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def kill(process: "subprocess.Popen[bytes]") -> None:
    """Kill a process and its children."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class Timed:
    """Pool that measures the rate of results, from the first batch of every worker on.

    Attributes:
        done: Number of results after the first batches.
        seconds: Time for these results, s.
    """

    def __init__(self, pool: Pool, workers: int, at: dict[int, object]) -> None:
        self._pool, self.workers = pool, workers
        self._at = dict(at)
        self._batches = self._all = self.done = 0
        self._begin = time.perf_counter()
        self.seconds = 0.0

    def submit(self, batch: object) -> None:
        """Give a batch to the workers."""
        self._pool.submit(batch)  # type: ignore[arg-type]

    def wait(self) -> Finished:
        """Wait for the end of a batch; disturb the cluster if it is time."""
        for number in [number for number in self._at if self._all >= number]:
            self._at.pop(number)()  # type: ignore[operator]
        finished = self._pool.wait()
        self._batches += 1
        self._all += len(finished.results)
        if self._batches <= 4 * self.workers:
            self._begin = time.perf_counter()
        else:
            self.done += len(finished.results)
            self.seconds = time.perf_counter() - self._begin
        return finished

    def __enter__(self) -> "Timed":
        self._pool.__enter__()
        return self

    def __exit__(self, *errors: object) -> None:
        self._pool.__exit__(*errors)


def rate(found: Campaign, folder: Path, port: int, workers: int) -> float:
    """Return the trials per second of some workers."""
    timed: list[Timed] = []
    with Cluster(port, workers) as cluster:

        def make(plan: object) -> Timed:
            pool = DaskPool(plan, cluster.address, None)  # type: ignore[arg-type]
            while pool.workers < workers:
                time.sleep(0.1)
            timed.append(Timed(pool, workers, {}))
            return timed[0]

        run_campaign(found, folder, make)  # type: ignore[arg-type]
    return timed[0].done / timed[0].seconds


def disturbed(found: Campaign, folder: Path, port: int) -> int:
    """Run a campaign through losses; return the number of results that the lost scheduler left."""
    with Cluster(port, 2) as cluster:
        third = len(found.trials) // 3
        at = {third: lambda: kill(cluster.workers[0]), 2 * third: lambda: kill(cluster.scheduler)}
        with suppress(CampaignError):
            run_campaign(found, folder, lambda plan: Timed(DaskPool(plan, cluster.address, None), 2, at))
    stored = len(read_results(folder))
    with Cluster(port + 1, 2) as cluster:
        run_campaign(found, folder, lambda plan: DaskPool(plan, cluster.address, None))
    return stored


def main() -> list[Row]:
    """Return all rows."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        many, few = campaign(folder, TRIALS), campaign(folder, TRIALS // SHARE)
        one = rate(few, folder / "one", 18_786, 1)
        two = rate(many, folder / "two", 18_796, 2)
        again = rate(few, folder / "again", 18_806, 1)
        stored = disturbed(many, folder / "disturbed", 18_816)
        run_campaign(few, folder / "local", lambda plan: LocalPool(plan, 2))
        tables = [(folder / run / "results.parquet").read_bytes() for run in ("two", "disturbed")]
        locals_ = [(folder / run / "results.parquet").read_bytes() for run in ("one", "local")]
    single = 0.5 * (one + again)
    return [
        Row("one worker", single, "trials/s"),
        Row("two workers", two, "trials/s"),
        Row("two workers against one", two / single, "x", GOAL, at_least=True),
        Row("results stored when the scheduler was lost", 100.0 * stored / TRIALS, "%"),
        Row(
            "table after the losses equal to the undisturbed one",
            float(tables[0] == tables[1]),
            "",
            1.0,
            True,
        ),
        Row("table of local workers equal to that of Dask", float(locals_[0] == locals_[1]), "", 1.0, True),
    ]


if __name__ == "__main__":
    report("campaign", main())
