"""``armgate demo``: the options of the demo."""

from pathlib import Path
from typing import Annotated

import typer


def demo(
    config: Annotated[
        Path | None,
        typer.Argument(
            metavar="CONFIG", help="Configuration of the cell (default: the demo cell).", show_default=False
        ),
    ] = None,
    *,
    links: Annotated[
        Path | None, typer.Option(help="Configuration to overlay, such as configs/links/….")
    ] = None,
    path: Annotated[
        Path | None, typer.Option(help="Recorded path of the leader (default: the inspection tour).")
    ] = None,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Run in lock-step: as fast as possible, and reproducible.")
    ] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.1, metavar="S", help="Play only the first S seconds of the path.")
    ] = None,
    no_view: Annotated[bool, typer.Option("--no-view", help="Do not open a viewer.")] = False,
    no_monitor: Annotated[bool, typer.Option("--no-monitor", help="Do not start the monitor.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the run (default: runs/<time>).")
    ] = None,
) -> None:
    """Run the whole stack on this machine: daemon, leader, follower, display and plots."""
    from armgate.apps.default_files import default_file
    from armgate.apps.demo.run import Options, run_demo

    configs = (config or default_file("demo.yaml"), *([links] if links else []))
    options = Options(
        configs,
        path or default_file("paths/inspection.csv"),
        lockstep=lockstep,
        duration=duration,
        view=not (no_view or lockstep),
        monitor=not no_monitor,
    )
    run_demo(options, out)
