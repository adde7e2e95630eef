"""Interface of the pools of workers, and the plan that workers receive."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.result import Result
from armgate.campaign.trials import Basis, Trial


@dataclass(frozen=True)
class Plan:
    """What a worker needs besides the trials.

    Attributes:
        campaign: The campaign.
        basis: What the keys of the trials depend on.
    """

    campaign: CampaignConfig
    basis: Basis


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
