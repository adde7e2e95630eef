"""``armgate experiment``: run the paper's experiments and check its claims."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgate.apps.default_files import default_file

if TYPE_CHECKING:
    from armgate.experiment.campaign import Campaign
    from armgate.experiment.experiment_file import Experiment


class Which(StrEnum):
    """Experiments that can be run."""

    APPROACH = "approach"
    TRACKING = "tracking"
    ZOOM = "zoom"
    COLLISION = "collision"
    ALL = "all"


def experiment(
    which: Annotated[
        Which,
        typer.Argument(metavar="EXPERIMENT", help="Experiment to run.", show_default=False),
    ],
    *,
    file: Annotated[
        Path | None,
        typer.Option(
            help="File of the experiment (default: configs/experiments/….yaml).", show_default=False
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(help="Configuration of the cell (default: the demo cell).", show_default=False),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=10_000,
            help="Number of leader paths or starts (default: as in the file).",
            show_default=False,
        ),
    ] = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Run by the wall clock instead of in lock-step.")
    ] = False,
    sockets: Annotated[
        bool,
        typer.Option("--sockets", help="Run all programs as processes that are connected by sockets."),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="Number of worker processes (default: one per core).", show_default=False
        ),
    ] = None,
    trial: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Run only this trial again, such as slow-1003, record it, and compare it with --out.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the results; existing runs are kept (default: runs/<time>).",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Run the paper's experiments and check its claims."""
    import os

    from armgate.apps.errors import AppError, UsageError
    from armgate.apps.stack.run_folder import make_folder
    from armgate.experiment.campaign import Campaign, Options
    from armgate.experiment.scene import build_scene

    if (sockets or realtime) and (jobs is not None or trial is not None):
        raise UsageError("--jobs and --trial are for worlds; expected no --sockets and no --realtime")
    setups = _setups(which, file)
    scene = build_scene((config or default_file("demo.yaml"),))
    options = Options(seeds, realtime, sockets, jobs or len(os.sched_getaffinity(0)))
    campaign = Campaign(scene, make_folder(out), options)
    if trial is not None:
        for line in campaign.repeat(setups, trial):
            typer.echo(line)
        return
    ended = campaign.run(setups)
    _report(campaign)
    if ended:
        raise AppError(f"incomplete, the finished runs are in {campaign.folder}: {ended}")


def _setups(which: Which, file: Path | None) -> dict[str, "Experiment"]:
    """Return the experiments to run, by name.

    Raises:
        UsageError: The file does not describe the chosen experiment.
    """
    from armgate.apps.errors import UsageError
    from armgate.experiment.experiment_file import load_experiment

    names = [one.value for one in Which if one is not Which.ALL] if which is Which.ALL else [which.value]
    if file is not None and len(names) > 1:
        raise UsageError("--file describes one experiment; expected the name of that experiment")
    setups = {name: load_experiment(file or default_file(f"experiments/{name}.yaml")) for name in names}
    if wrong := [name for name, setup in setups.items() if setup.experiment != name]:
        raise UsageError(f"{file} describes {setups[wrong[0]].experiment}; expected {wrong[0]}")
    return setups


def _report(campaign: "Campaign") -> None:
    from rich.console import Console

    console = Console(highlight=False)
    for table in campaign.tables():
        console.print(table)
    console.print(f"{campaign.folder}: metrics.json, and report.html for each experiment", style="dim")
