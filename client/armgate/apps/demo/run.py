"""The demo: plan its processes, run them, then write figures and print a summary."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from armgate.apps.demo.display import screen
from armgate.apps.demo.plots import draw
from armgate.apps.demo.summary import summary
from armgate.apps.errors import UsageError
from armgate.apps.lead.path import RecordedPath, read_path
from armgate.apps.stack.metrics import columns, compute
from armgate.apps.stack.monitoring import read_report
from armgate.apps.stack.plan import FOLLOWER, LEADER, Plan
from armgate.apps.stack.processes import Children
from armgate.apps.stack.robot_processes import robots_of
from armgate.apps.stack.run import Watch, interruptions, run
from armgate.apps.stack.run_folder import make_folder, write_metrics, write_series
from armgate.cell.config import CellConfig, dump_config, load_config
from armgate.cell.errors import install_hint

NAMES = (LEADER, FOLLOWER)
"""Participants of the demo."""


@dataclass(frozen=True)
class Options:
    """Options of ``armgate demo``.

    Attributes:
        configs: Configuration files of the cell; later ones overlay earlier ones.
        path: Recorded path of the leader.
        lockstep: True if ticks wait for the controllers instead of the clock.
        duration: Duration of the path that is played, s; None for the whole path.
        view: True if a viewer is opened, provided that it is installed.
        monitor: True if the monitor checks the run.
    """

    configs: tuple[Path, ...]
    path: Path
    lockstep: bool = False
    duration: float | None = None
    view: bool = True
    monitor: bool = True


def run_demo(options: Options, out: Path | None) -> None:
    """Run the demo, write its folder (``runs/<time>`` unless ``out`` is given) and print a summary.

    Raises:
        ConfigError: The configuration has an error.
        AppError: The options do not fit the cell, or a process failed.
    """
    cell = load_config(options.configs)
    chosen = demo_plan(options, cell)
    folder = make_folder(out)
    (folder / "config.yaml").write_text(dump_config(cell), encoding="utf-8")
    robots = robots_of(cell, options.configs, folder)
    view = options.view and _has_viewer()
    _run(replace(chosen, record=folder, robots=robots, view=view, monitor=options.monitor), folder)


def _has_viewer() -> bool:
    """Return True if the viewer is installed; otherwise print how to install it."""
    if all(find_spec(name) for name in ("viser", "moderngl")):
        return True
    typer.echo(f"no viewer; to see the run in a browser, run {install_hint('view')}")
    return False


def demo_plan(options: Options, cell: CellConfig) -> Plan:
    """Return the plan: the path's robot leads, the first other robot with a camera follows.

    Raises:
        UsageError: The path, the cameras or the clock of the cell do not fit the demo.
    """
    recorded = read_path(options.path)
    _check_leader(recorded, cell)
    cameras = [name for name, robot in cell.robots.items() if robot.camera and name != recorded.robot]
    if not cameras:
        raise UsageError(
            f"no robot of cell {cell.name!r} other than {recorded.robot} has a camera; the demo needs one"
        )
    if cell.clock.kind == "lockstep" and set(cell.clock.participants) != set(NAMES):
        raise UsageError(
            f"clock.participants are {', '.join(cell.clock.participants)}; "
            f"expected those of the demo: {', '.join(NAMES)}"
        )
    lag = cell.robots[cameras[0]].link.lag
    return plan(options.configs, options.path, recorded.robot, cameras[0], lag=lag,
                lockstep=options.lockstep, duration=options.duration)  # fmt: skip


def _check_leader(path: RecordedPath, cell: CellConfig) -> None:
    if path.robot not in cell.robots:
        known = ", ".join(cell.robots)
        raise UsageError(f"{path.file} was recorded with {path.robot}; cell {cell.name!r} has only {known}")


def plan(
    configs: Sequence[Path],
    path: Path,
    leader: str,
    follower: str,
    *,
    lag: float = 0.03,
    lockstep: bool = False,
    duration: float | None = None,
) -> Plan:
    """Return the plan in which one robot plays a path, and another robot keeps its camera on the tool.

    Args:
        configs: Configuration files of the daemon; later ones overlay earlier ones.
        path: Recorded path of the leader.
        leader: Robot that plays the path.
        follower: Robot that carries the camera.
        lag: Lag of the follower's robot behind its setpoint, s.
        lockstep: True if ticks wait for the controllers instead of the clock.
        duration: Duration of the path that is played, s; None for the whole path.
    """
    lead = ["lead", "--robot", leader, "--path", str(path)]
    lead += [] if duration is None else ["--duration", str(duration)]
    follow = ["follow", "--robot", follower, "--leader", leader, "--lag", str(lag)]
    return Plan(configs, follower, {LEADER: lead, FOLLOWER: follow}, lockstep)


def _run(plan: Plan, folder: Path) -> None:
    with Children(folder / "logs") as children, interruptions(children):
        with screen(sys.stdout.isatty()) as show:
            ended = run(children, plan, show)
        metrics, pictures = _evaluate(ended.watch, ended.complete, folder)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    console.print(summary(metrics, folder, pictures))
    if ended.failure is not None:
        raise ended.failure


def _evaluate(watch: Watch, complete: bool, folder: Path) -> tuple[dict[str, Any], list[Path]]:
    """Write series, metrics and pictures."""
    seen = watch.seen
    metrics = compute(seen, watch.cell.stop_distance, watch.wall, complete, read_report(folder))
    write_series(folder, seen.rows)
    write_metrics(folder, metrics)
    return metrics, draw(columns(seen.rows), metrics, folder)
