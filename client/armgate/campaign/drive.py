"""Run of a campaign: open the store, run the missing trials, write table and report."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armgate.campaign.basis import basis_of
from armgate.campaign.campaign_file import CampaignConfig, load_campaign
from armgate.campaign.claims import Checked, check_claims, check_figures
from armgate.campaign.pool import CampaignPlan, Plan, Pool
from armgate.campaign.progress import progress
from armgate.campaign.report import report_page
from armgate.campaign.result import Result
from armgate.campaign.schedule import Schedule
from armgate.campaign.start_checks import check_start
from armgate.campaign.store import Store
from armgate.campaign.table import result_of
from armgate.campaign.trials import Basis, Trial, trials
from armgate.campaign.variations import cell_tree, check_keys
from armgate.cell.cell import build_cell
from armgate.cell.config import config_of

MakePool = Callable[[Plan], Pool]
"""Function that starts the workers."""
UNHASHED = {"claims", "timeout", "attempts"}
"""Keys of the file that do not change any figure; they may differ between two runs of one store."""


@dataclass(frozen=True)
class Campaign:
    """Campaign that is ready to run.

    Attributes:
        config: Its file.
        basis: Data on which the keys of the trials depend, besides the file.
        trials: All its trials.
    """

    config: CampaignConfig
    basis: Basis
    trials: list[Trial]

    @classmethod
    def load(cls, file: Path) -> "Campaign":
        """Read a campaign, and run all checks that are possible before a trial.

        Raises:
            ConfigError: The file, or the configuration of a cell, is not valid.
            EntryError: A Python entry cannot be imported.
        """
        config = load_campaign(file)
        check_keys(config)
        trees = {name: cell_tree(config, name) for name in config.scenarios}
        cells = {name: build_cell(config_of(tree)) for name, tree in trees.items()}
        check_figures(config, sorted({robot.name for cell in cells.values() for robot in cell.robots}))
        basis = basis_of(config, cells)
        found = trials(config, basis)
        check_start(config, trees, cells, found)
        return cls(config, basis, found)

    @property
    def manifest(self) -> Mapping[str, Any]:
        """Content that two runs of one store have in common."""
        dump = self.config.model_dump(mode="json", exclude=UNHASHED)
        return {
            "campaign": dump,
            "versions": dict(self.basis.versions),
            "sources": dict(self.basis.sources),
            "cells": dict(self.basis.cells),
        }


@dataclass(frozen=True)
class Summary:
    """End of a run of a campaign.

    Attributes:
        folder: Folder of the store.
        done: Number of results.
        planned: Number of trials.
        reasons: Numbers of failed trials by reason.
        claims: Claims with their outcomes.
        interrupted: True if the user ended the run.
    """

    folder: Path
    done: int
    planned: int
    reasons: Counter[str]
    claims: list[Checked]
    interrupted: bool

    @property
    def failed(self) -> int:
        """Number of failed trials."""
        return self.reasons.total()

    @property
    def succeeded(self) -> bool:
        """True if all claims hold; without claims, if no trial failed."""
        return all(claim.holds for claim in self.claims) if self.claims else not self.failed


def run_campaign(campaign: Campaign, folder: Path, make_pool: MakePool) -> Summary:
    """Run the trials of a campaign that have no result yet.

    Raises:
        UsageError: The store is in use, or belongs to another campaign.
        CampaignError: The disk is full, or the workers are lost; the results so far are stored.
    """
    with Store(folder, campaign.manifest) as store:
        missing = [trial for trial in campaign.trials if trial.key not in store]
        plan = CampaignPlan(campaign.config, campaign.basis)
        run = MissingTrials(missing, len(campaign.trials), plan, campaign.config.attempts)
        interrupted = run.run(store, make_pool)
        results = {key: result_of(row) for key, row in store.rows.items()}
    return _sum_up(campaign, folder, results, interrupted)


@dataclass(frozen=True)
class MissingTrials:
    """Trials of a campaign that have no result yet.

    Attributes:
        trials: These trials.
        planned: Number of all trials.
        plan: Input of the workers.
        attempts: Attempts of a trial whose worker ends.
    """

    trials: Sequence[Trial]
    planned: int
    plan: Plan
    attempts: int = 3

    def run(self, store: Store, make_pool: MakePool) -> bool:
        """Run the trials, and store the results; complete the store unless the user interrupts the run.

        Returns:
            True if the user interrupted the run.

        Raises:
            CampaignError: The disk is full, or the workers are lost; the results so far are stored.
        """
        if self.trials and self._interrupted(store, make_pool):
            store.flush()
            return True
        store.complete()
        return False

    def _interrupted(self, store: Store, make_pool: MakePool) -> bool:
        by_key = {trial.key: trial for trial in self.trials}
        with (
            progress(self.planned, self.planned - len(self.trials)) as shown,
            make_pool(self.plan) as pool,
        ):

            def take(result: Result) -> None:
                store.put(by_key[result.key], result)
                shown.done(result.failed)

            try:
                Schedule(pool, take, self.attempts, self.plan.timeout).run(self.trials)
            except KeyboardInterrupt:
                return True
        return False


def _sum_up(campaign: Campaign, folder: Path, results: Mapping[str, Result], interrupted: bool) -> Summary:
    claims = check_claims(campaign.config, campaign.trials, results, complete=not interrupted)
    page = report_page(campaign.config, campaign.trials, results, claims, folder)
    (folder / "report.html").write_text(page, encoding="utf-8")
    reasons = Counter(result.reason for result in results.values() if result.failed)
    return Summary(folder, len(results), len(campaign.trials), reasons, claims, interrupted)
