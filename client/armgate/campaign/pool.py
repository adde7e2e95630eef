"""Interfaces of the pools of workers and of the plans that workers receive, and the plan of a campaign."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.laboratory import Laboratory
from armgate.campaign.result import Result
from armgate.campaign.trials import Basis, Trial


class Lab(Protocol):
    """Runner of trials in a worker, which keeps their shared data."""

    def run(self, trial: Trial) -> Result:
        """Run a trial; an error of the trial is a failed result.

        Raises:
            CampaignError: The campaign cannot continue.
        """


class Plan(Protocol):
    """Input of a worker besides the trials; it is pickled."""

    @property
    def timeout(self) -> float:
        """Longest time of a trial, s."""

    def laboratory(self) -> Lab:
        """Return the runner of the trials.

        Raises:
            CampaignError: This machine differs from the one of the driver.
        """


@dataclass(frozen=True)
class CampaignPlan:
    """Plan of a campaign from a file; a `Plan`.

    Attributes:
        campaign: The campaign.
        basis: Data on which the keys of the trials depend.
    """

    campaign: CampaignConfig
    basis: Basis

    @property
    def timeout(self) -> float:
        """Longest time of a trial, s."""
        return self.campaign.timeout

    def laboratory(self) -> Laboratory:
        """Return the runner of the trials.

        Raises:
            WorkerError: Versions on this machine differ from the basis.
            EntryError: A Python entry cannot be imported.
        """
        return Laboratory(self.campaign, self.basis)


@dataclass(frozen=True)
class Finished:
    """End of a batch of trials.

    Attributes:
        results: Results of the trials that ended.
        suspects: Trials that may have ended their worker.
        exact: True if the suspect was certainly running; False if it may only have waited for the worker.
        lost: Other trials that were not run because their worker ended.
        seconds: Time that the worker took, s.
    """

    results: Sequence[Result]
    suspects: Sequence[Trial] = ()
    exact: bool = False
    lost: Sequence[Trial] = ()
    seconds: float = 0.0


class Pool(Protocol):
    """Workers that run batches of trials; a context manager that ends them."""

    @property
    def workers(self) -> int:
        """Number of workers."""

    def submit(self, batch: Sequence[Trial]) -> None:
        """Give a batch to the workers."""

    def wait(self) -> Finished:
        """Wait for the next end of a batch, of which at least one is submitted.

        Raises:
            WorkerError: A worker has other software or files.
            CampaignError: The workers are lost.
        """

    def __enter__(self) -> "Pool": ...

    def __exit__(self, *_: object) -> None: ...
