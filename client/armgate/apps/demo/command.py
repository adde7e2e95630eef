"""``armgate demo``: what to run, on which screen, and what is left of it."""

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armgate.apps.data import default_file
from armgate.apps.errors import UsageError
from armgate.cell.extras import install

if TYPE_CHECKING:
    from armgate.apps.lead.path import RecordedPath
    from armgate.apps.stack.run import Plan, Watch
    from armgate.cell.config import CellConfig


def demo(
    config: Annotated[
        Path | None,
        typer.Argument(help="Configuration of the cell; the demo cell if none is named.", show_default=False),
    ] = None,
    *,
    links: Annotated[
        Path | None, typer.Option(help="A configuration to overlay, such as configs/links/….")
    ] = None,
    path: Annotated[
        Path | None, typer.Option(help="The leader's recorded path; the inspection tour if none.")
    ] = None,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="As fast as the machine can, the same each time.")
    ] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.1, metavar="S", help="Play only the first S seconds of the path.")
    ] = None,
    no_view: Annotated[bool, typer.Option("--no-view", help="Open no viewer.")] = False,
    no_monitor: Annotated[bool, typer.Option("--no-monitor", help="Run without the monitor.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the run; runs/<time> if none is named.")
    ] = None,
) -> None:
    """Run the whole stack here: daemon, leader, follower, display, plots."""
    from armgate.apps.stack.folder import make_folder
    from armgate.apps.stack.robots import robots_of
    from armgate.cell.config import dump_config, load_config

    configs = [config or default_file("demo.yaml"), *([links] if links else [])]
    resolved = load_config(configs)
    plan = _plan(configs, resolved, path or default_file("paths/inspection.csv"), lockstep, duration)
    folder = make_folder(out)
    (folder / "config.yaml").write_text(dump_config(resolved), encoding="utf-8")
    robots = robots_of(resolved, configs, folder)
    view = not (no_view or lockstep) and _has_viewer()
    _run(replace(plan, record=folder, robots=robots, view=view, monitor=not no_monitor), folder)


def _has_viewer() -> bool:
    """Whether the viewer is installed; says so if it is not."""
    if all(find_spec(name) for name in ("viser", "moderngl")):
        return True
    typer.echo(f"no viewer; to see the run in a browser, run {install('view')}")
    return False


def _plan(
    configs: list[Path], cell: "CellConfig", path: Path, lockstep: bool, duration: float | None
) -> "Plan":
    """Who does what: the path names the leader's robot, the camera tells the follower's."""
    from armgate.apps.demo.plan import NAMES, plan
    from armgate.apps.lead.path import read_path

    recorded = read_path(path)
    _check_leader(recorded, cell)
    cameras = [name for name, robot in cell.robots.items() if robot.camera and name != recorded.robot]
    if not cameras:
        raise UsageError(
            f"no robot of cell {cell.name!r} has a camera; the demo needs one beside {recorded.robot}"
        )
    if cell.clock.kind == "lockstep" and set(cell.clock.participants) != set(NAMES):
        raise UsageError(
            f"clock.participants are {', '.join(cell.clock.participants)}; "
            f"expected the demo's: {', '.join(NAMES)}"
        )
    lag = cell.robots[cameras[0]].link.lag
    return plan(configs, path, recorded.robot, cameras[0], lag=lag, lockstep=lockstep, duration=duration)


def _check_leader(path: "RecordedPath", cell: "CellConfig") -> None:
    if path.robot not in cell.robots:
        known = ", ".join(cell.robots)
        raise UsageError(f"{path.file} was recorded with {path.robot}; cell {cell.name!r} has only {known}")


def _run(plan: "Plan", folder: Path) -> None:
    from armgate.apps.demo.screen import screen
    from armgate.apps.stack.processes import Crew
    from armgate.apps.stack.run import interruptions, run

    with Crew(folder / "logs") as crew, interruptions(crew):
        with screen(sys.stdout.isatty()) as show:
            ended = run(crew, plan, show)
        metrics, pictures = _evaluate(ended.watch, ended.complete, folder)
    _tell(metrics, folder, pictures)
    if ended.failure is not None:
        raise ended.failure


def _evaluate(watch: "Watch", complete: bool, folder: Path) -> tuple[dict[str, Any], list[Path]]:
    """Writes series, metrics and pictures."""
    from armgate.apps.demo.plots import draw
    from armgate.apps.stack.folder import write_metrics, write_series
    from armgate.apps.stack.judge import account
    from armgate.apps.stack.metrics import columns, compute

    seen = watch.seen
    metrics = compute(seen, watch.cell.stop_distance, watch.wall, complete, account(folder))
    write_series(folder, seen.rows)
    write_metrics(folder, metrics)
    return metrics, draw(columns(seen.rows), metrics, folder)


def _tell(metrics: dict[str, Any], folder: Path, pictures: list[Path]) -> None:
    from rich.console import Console

    from armgate.apps.demo.summary import summary

    Console(highlight=False, soft_wrap=not sys.stdout.isatty()).print(summary(metrics, folder, pictures))
