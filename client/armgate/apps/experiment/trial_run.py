"""Run of one trial with the whole stack: daemon, leader, follower and operator as processes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgate.apps.experiment.figures import evaluate
from armgate.apps.experiment.scene import Scene
from armgate.apps.experiment.trials import Trial
from armgate.apps.lead.path import format_path
from armgate.apps.stack.fork_server import ForkServer
from armgate.apps.stack.metrics import compute
from armgate.apps.stack.monitoring import read_report
from armgate.apps.stack.plan import FOLLOWER, LEADER, Plan
from armgate.apps.stack.processes import Children
from armgate.apps.stack.run import Watch, interruptions, run
from armgate.apps.stack.run_folder import write_metrics, write_series

OPERATOR = "operator"


def play(
    trial: Trial,
    scene: Scene,
    folder: Path,
    fork_server: ForkServer,
    *,
    realtime: bool,
    show: Callable[[Watch], None],
) -> dict[str, Any] | None:
    """Run a trial and write its folder.

    Returns:
        The figures of the trial; None if it was interrupted.

    Raises:
        AppError: A process failed, was stopped, or was not ready in time.
    """
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    with Children(folder / "logs", fork_server) as children, interruptions(children):
        ended = run(children, plan(trial, scene, folder, realtime), show)
    if ended.failure is not None:
        raise ended.failure
    if not ended.complete:
        return None
    watch = ended.watch
    figures = compute(
        watch.seen, watch.cell.stop_distance, watch.wall, complete=True, report=read_report(folder)
    )
    entry = {"case": trial.case, "seed": trial.seed, **figures, **evaluate(trial, watch.seen)}
    write_series(folder, watch.seen.rows)
    write_metrics(folder, entry)
    return entry


def plan(trial: Trial, scene: Scene, folder: Path, realtime: bool) -> Plan:
    """Return the plan of a trial, and write the files that it needs."""
    overlay = folder / "overlay.yaml"
    overlay.write_text(yaml.safe_dump(_overlay(trial, scene), sort_keys=False), encoding="utf-8")
    follower, leader = scene.follower.name, scene.leader.name
    controllers: dict[str, tuple[str, ...]] = {}
    if trial.pursue is not None:
        controllers[LEADER] = ("lead", "--robot", leader, *trial.pursue)
    elif trial.path is not None:
        path = folder / "path.csv"
        joints = [
            (joint.name, "rad" if joint.kind == "revolute" else "m") for joint in scene.leader.model.joints
        ]
        text = format_path(leader, joints, scene.leader.period, scene.carried(trial.path))
        path.write_text(text, encoding="utf-8")
        controllers[LEADER] = ("lead", "--robot", leader, "--path", str(path))
    controllers[FOLLOWER] = (
        *("follow", "--robot", follower, "--leader", leader, "--lag", str(trial.lag)), *trial.follow,
        *(() if trial.seconds is None else ("--duration", str(trial.seconds))),
    )  # fmt: skip
    if trial.zoom is not None:
        controllers[OPERATOR] = ("zoom", *trial.zoom)
    return Plan(
        (*scene.configs, overlay), follower, controllers, not realtime, until=(FOLLOWER,), record=folder
    )


def _overlay(trial: Trial, scene: Scene) -> dict[str, Any]:
    """Return the changes of a trial to the cell's configuration."""
    robots: dict[str, Any] = {
        robot.name: {"link": {"kind": "emulated", "lag": trial.lag}}
        for robot in (scene.follower, scene.leader)
    }
    if trial.start is not None:
        robots[scene.follower.name]["start"] = np.asarray(trial.start).tolist()
    if trial.path is not None:
        robots[scene.leader.name]["start"] = scene.carried(trial.path[:1])[0].tolist()
    return {"armgate": 1, "robots": robots}
