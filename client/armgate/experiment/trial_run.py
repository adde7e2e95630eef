"""Run of one trial with the whole stack: daemon, leader, follower and operator as processes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgate.apps.lead.path import format_path
from armgate.apps.stack.fork_server import ForkServer
from armgate.apps.stack.metrics import compute
from armgate.apps.stack.monitoring import read_report
from armgate.apps.stack.plan import FOLLOWER, LEADER, Plan
from armgate.apps.stack.processes import Children
from armgate.apps.stack.run import Watch, interruptions, run
from armgate.apps.stack.run_folder import write_metrics, write_series
from armgate.experiment.figures import evaluate
from armgate.experiment.scene import Scene
from armgate.experiment.trials import Array, DistanceRange, Trial

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
        watch.seen,
        watch.cell.stop_distance,
        watch.wall if realtime else 0.0,
        complete=True,
        report=read_report(folder),
    )
    entry = {"case": trial.case, "seed": trial.seed, **figures, **evaluate(trial, watch.seen)}
    write_series(folder, watch.seen.rows)
    write_metrics(folder, entry)
    return entry


def plan(trial: Trial, scene: Scene, folder: Path, realtime: bool) -> Plan:
    """Return the plan of a trial, and write the files that it needs."""
    file = folder / "overlay.yaml"
    file.write_text(yaml.safe_dump(overlay(trial, scene), sort_keys=False), encoding="utf-8")
    controllers: dict[str, tuple[str, ...]] = {}
    if trial.path is not None:
        controllers[LEADER] = _lead(trial, scene, trial.path, folder)
    controllers[FOLLOWER] = _follow(trial, scene)
    if trial.zoom is not None:
        controllers[OPERATOR] = _zoom(trial, trial.zoom)
    follower = scene.follower.name
    return Plan((*scene.configs, file), follower, controllers, not realtime, until=(FOLLOWER,), record=folder)


def _lead(trial: Trial, scene: Scene, path: Array, folder: Path) -> tuple[str, ...]:
    own = ("lead", "--robot", scene.leader.name)
    if trial.pursuit is not None:
        body = f"{scene.follower.name}/{trial.pursuit.body}"
        return (*own, "--pursue", body, "--tool-speed", str(trial.pursuit.speed))
    file = folder / "path.csv"
    file.write_text(path_text(scene, path), encoding="utf-8")
    return (*own, "--path", str(file))


def path_text(scene: Scene, path: Array) -> str:
    """Return the leader's path file for a path of its tool (k, 3), m."""
    robot = scene.leader
    joints = [(joint.name, "rad" if joint.kind == "revolute" else "m") for joint in robot.model.joints]
    return format_path(robot.name, joints, robot.period, scene.carried(path))


def _follow(trial: Trial, scene: Scene) -> tuple[str, ...]:
    return (
        "follow", "--robot", scene.follower.name, "--leader", scene.leader.name, "--lag", str(trial.lag),
        "--distance", str(trial.distance), "--predict" if trial.predict else "--no-predict",
        *(() if trial.focus is None else ("--focus", *map(str, trial.focus))),
        *(() if trial.seconds is None else ("--duration", str(trial.seconds))),
    )  # fmt: skip


def _zoom(trial: Trial, own: DistanceRange) -> tuple[str, ...]:
    return (
        "zoom", "--low", str(own.low), "--high", str(own.high), "--rate", str(own.rate),
        "--start", str(trial.distance), "--seed", str(trial.seed),
    )  # fmt: skip


def overlay(trial: Trial, scene: Scene) -> dict[str, Any]:
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
