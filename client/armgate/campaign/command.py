"""``armgate campaign``: run many trials of controllers in a cell, and check claims."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from armgate.campaign.drive import Campaign, MakePool, Summary

REASONS = 3
"""Number of reasons of failed trials that are printed; the report lists the trials."""


def campaign(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File of the campaign (YAML).")],
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the results; existing results are kept (default: runs/NAME).",
            show_default=False,
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="Number of worker processes (default: one per core).", show_default=False
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of a Dask cluster, such as tcp://host:8786.",
            show_default=False,
        ),
    ] = None,
    dask: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1024,
            metavar="N",
            help="Start a Dask cluster with N workers on this machine.",
            show_default=False,
        ),
    ] = None,
    trial: Annotated[
        str | None,
        typer.Option(
            metavar="KEY",
            help="Run only the trial with this key, record it, and compare its figures.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Run a campaign: scenarios × controllers × seeds, on all cores or on a Dask cluster.

    Exit status: 0 if all claims hold (without claims: if no trial failed), 1 if not or if trials are missing,
    2 for wrong use.
    """
    from armgate.campaign.drive import Campaign, run_campaign
    from armgate.campaign.errors import UsageError

    if sum(one is not None for one in (jobs, scheduler, dask, trial)) > 1:
        raise UsageError("expected at most one of --jobs, --scheduler, --dask and --trial")
    loaded = Campaign.load(file)
    folder = out or Path("runs") / loaded.config.name
    if trial is not None:
        _reproduce(loaded, folder, trial)
        return
    summary = run_campaign(loaded, folder, _pool(jobs, scheduler, dask))
    _report(summary)


def _pool(jobs: int | None, scheduler: str | None, dask: int | None) -> "MakePool":
    """Return the function that starts the workers."""
    import os

    from armgate.campaign.local_pool import LocalPool

    if scheduler is not None or dask is not None:
        from armgate.campaign.dask_pool import DaskPool

        return lambda plan: DaskPool(plan, scheduler, dask)
    workers = jobs or len(os.sched_getaffinity(0))
    return lambda plan: LocalPool(plan, workers)


def _reproduce(loaded: "Campaign", folder: Path, key: str) -> None:
    from armgate.campaign.reproduce import reproduce_trial

    for line in reproduce_trial(loaded, folder, key):
        typer.echo(line)


def _report(summary: "Summary") -> None:
    """Print the claims and why trials failed; exit with status 1 if a claim does not hold.

    Raises:
        CampaignError: The campaign was interrupted.
    """
    from rich.console import Console

    from armgate.campaign.claims_table import claims_table
    from armgate.campaign.errors import CampaignError

    if summary.interrupted:
        raise CampaignError(
            f"interrupted with {summary.done} of {summary.planned} results in {summary.folder}; "
            "run the same command again to continue"
        )
    console = Console(highlight=False, soft_wrap=True)
    if summary.claims:
        console.print(claims_table(summary.claims))
    for reason, count in summary.reasons.most_common(REASONS):
        console.print(f"{count} failed: {reason}", markup=False)
    failed = f", {summary.failed} failed" if summary.failed else ""
    console.print(
        f"{summary.done} trials{failed}; {summary.folder}: results.parquet, report.html", style="dim"
    )
    if not summary.succeeded:
        raise typer.Exit(1)
