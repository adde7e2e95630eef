"""Campaigns on a Dask cluster: lost workers and a lost scheduler change nothing in the results."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from armgate.campaign.dask_pool import DaskPool
from armgate.campaign.drive import Campaign, run_campaign
from armgate.campaign.errors import CampaignError
from armgate.campaign.local_pool import LocalPool
from armgate.campaign.pool import CampaignPlan, Finished
from armgate.campaign.store import read_results
from support.campaigns import small_campaign
from support.ports import free_ports


class Cluster:
    """Scheduler and workers as processes, as on several machines."""

    def __init__(self, workers: int) -> None:
        self.address = f"tcp://127.0.0.1:{free_ports(1)[0]}"
        host, port = self.address.removeprefix("tcp://").split(":")
        self.scheduler = _dask("scheduler", "--host", host, "--port", port, "--no-dashboard", "--no-show")
        self.workers = [self.worker() for _ in range(workers)]

    def worker(self) -> "subprocess.Popen[bytes]":
        return _dask("worker", self.address, "--nthreads", "1", "--no-dashboard", "--death-timeout", "20")

    def end(self) -> None:
        for process in (*self.workers, self.scheduler):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _dask(*words: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    return small_campaign(tmp_path, seeds=10, programs=("move", "ends"))


@pytest.fixture
def cluster() -> Iterator[list[Cluster]]:
    made: list[Cluster] = []
    yield made
    for one in made:
        one.end()


class Disturbed(DaskPool):
    """Pool that ends something after some batches."""

    disturb = staticmethod(lambda _number: None)
    number = 0

    def wait(self) -> Finished:
        self.number += 1
        type(self).disturb(self.number)
        return super().wait()


@pytest.mark.slow
def test_a_killed_worker_and_a_killed_scheduler_change_nothing(
    tmp_path: Path, campaign: Campaign, cluster: list[Cluster], monkeypatch: pytest.MonkeyPatch
) -> None:
    run_campaign(campaign, tmp_path / "undisturbed", lambda plan: LocalPool(plan, 2))
    cluster.append(Cluster(2))
    first = cluster[0]

    def disturb(number: int) -> None:
        if number == 4:
            os.killpg(first.workers[0].pid, signal.SIGKILL)
        if number == 9:
            os.killpg(first.scheduler.pid, signal.SIGKILL)

    monkeypatch.setattr(Disturbed, "disturb", staticmethod(disturb))
    monkeypatch.setattr("armgate.campaign.schedule.LARGEST", 1)
    monkeypatch.setattr("armgate.campaign.dask_pool.LOST_TIME", 0.5)
    with pytest.raises(CampaignError, match=r"the Dask scheduler tcp://.* is lost; start it and its workers"):
        run_campaign(campaign, tmp_path / "out", lambda plan: Disturbed(plan, first.address, None))
    stored = len(read_results(tmp_path / "out"))
    assert 0 < stored < len(campaign.trials)
    cluster.append(Cluster(1))
    run_campaign(campaign, tmp_path / "out", lambda plan: DaskPool(plan, cluster[1].address, None))
    tables = [(tmp_path / name / "results.parquet").read_bytes() for name in ("undisturbed", "out")]
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_a_trial_that_ends_its_worker_is_a_result(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=1, programs=("move", "killed"), more="attempts: 1")
    summary = run_campaign(campaign, tmp_path / "out", lambda plan: DaskPool(plan, None, 1))
    assert (summary.done, summary.failed) == (2, 1)


def test_an_address_without_scheduler_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armgate.campaign.dask_pool.CONNECT_TIME", 0.5)
    campaign = small_campaign(tmp_path, seeds=1)
    begin = time.monotonic()
    address = f"tcp://127.0.0.1:{free_ports(1)[0]}"
    with pytest.raises(CampaignError, match=rf"{address}: no Dask scheduler with workers answers"):
        DaskPool(CampaignPlan(campaign.config, campaign.basis), address, None)
    assert time.monotonic() - begin < 60.0
