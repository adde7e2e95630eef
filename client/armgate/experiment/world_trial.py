"""Run of one trial in a world: the programs of leader, follower and operator, without processes."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import yaml

from armgate.apps.cli import main
from armgate.apps.errors import AppError
from armgate.apps.follow.loop import FollowOptions
from armgate.apps.follow.program import FollowProgram
from armgate.apps.lead.drive import PathProgram, bounds_of, check_path
from armgate.apps.lead.path import read_path
from armgate.apps.lead.playback import Playback
from armgate.apps.lead.pursuit import pursuit_program
from armgate.apps.stack.metrics import compute
from armgate.apps.stack.monitoring import read_report
from armgate.apps.stack.observation import Observation
from armgate.apps.stack.plan import FOLLOWER, LEADER
from armgate.apps.stack.run_folder import write_metrics, write_series
from armgate.apps.zoom.schedule import DistanceSchedule, ZoomProgram
from armgate.cell.cell import build_cell
from armgate.cell.config import in_lockstep, load_config
from armgate.client import State
from armgate.client.program import Program, ProgramContext, ignore
from armgate.experiment.figures import evaluate
from armgate.experiment.scene import Scene
from armgate.experiment.trial_run import OPERATOR, overlay, path_text
from armgate.experiment.trials import Array, DistanceRange, Trial
from armgate.programs import Controller, WorldCell, WorldRun
from armgate.protocol import messages as m
from armgate.recorder import WorldRecorder
from armgate.recording.codec import rounded
from armgate.world import World, WorldClient

OBSERVER = "demo"
"""Name of the client that observes the run."""
METRICS, SERIES, REPORT = "metrics.json", "series.csv", "monitor.json"
"""Files of a run: its figures, its series, and the report of the monitor."""


def play_in_world(trial: Trial, scene: Scene, folder: Path, *, record: bool = False) -> dict[str, Any]:
    """Run a trial in a world and write its folder.

    Args:
        trial: The trial.
        scene: The cell.
        folder: Folder of the results; created if it does not exist.
        record: True to record the run in the folder, and to audit the recording by the monitor.

    Returns:
        The figures of the trial: those of the same trial over sockets in lock-step.

    Raises:
        AppError: A program failed, its robot was stopped, or the monitor reports a violation.
    """
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        recorders = [stack.enter_context(WorldRecorder(folder))] if record else []
        observer = _observed(trial, scene, folder, recorders)
    report = audit(folder) if record else None
    figures = compute(observer.seen, observer.stop_distance, wall=0.0, complete=True, report=report)
    entry = {"case": trial.case, "seed": trial.seed, **figures, **evaluate(trial, observer.seen)}
    write_series(folder, observer.seen.rows)
    write_metrics(folder, entry)
    return entry


def _observed(trial: Trial, scene: Scene, folder: Path, recorders: Sequence[WorldRecorder]) -> "Observer":
    """Run a trial in a world to its end; return its observer."""
    own = controllers(trial, scene, folder)
    file = folder / "overlay.yaml"
    file.write_text(yaml.safe_dump(overlay(trial, scene), sort_keys=False), encoding="utf-8")
    cell = build_cell(in_lockstep(load_config([*scene.configs, file]), list(own)))
    world = World(cell, recorders=recorders)
    observer = Observer(world, scene.follower.name)
    run = WorldRun(world, own, until=(FOLLOWER,))
    observer.take()
    while run.step():
        observer.take()
    for name, outcome in run.outcomes.items():
        if outcome is not None and outcome.failed:
            raise AppError(f"the {name} failed: {outcome.text}")
    run.close()
    return observer


def audit(folder: Path) -> Mapping[str, Any] | None:
    """Audit the recording in a folder by ``armgate monitor``; return its report.

    Raises:
        AppError: The monitor reports a violation, or fails.
    """
    log = folder / "logs" / "monitor.log"
    with log.open("w", encoding="utf-8") as output, redirect_stdout(output), redirect_stderr(output):
        try:
            main(["monitor", str(folder), "--json", str(folder / REPORT)])
        except SystemExit as end:
            status = end.code
    if status:
        last = log.read_text(encoding="utf-8").strip().rpartition("\n")[2]
        raise AppError(f"the monitor ended ({status}): {last}; see {log}")
    return read_report(folder)


class Observer:
    """Client of a world that observes every state at the ticks of the follower's robot.

    Args:
        world: The world.
        follower: Robot with the camera.

    Attributes:
        seen: The observation.
        stop_distance: Distance that the gate keeps to other robots and surroundings, m.
    """

    def __init__(self, world: World, follower: str) -> None:
        self._client: WorldClient = world.join(OBSERVER, "observer")
        self.seen = Observation(follower, until_released=True)
        self.stop_distance = WorldCell(self._client).description.stop_distance
        self._client.send(m.Subscribe(every=1, robots=(follower,)))

    def take(self) -> None:
        """Observe the states since the last call, with the precision of a recording."""
        for state in self._client.take(State):
            entries = tuple(map(rounded, state.entries))
            self.seen.take(state.model_copy(update={"entries": entries}))


def controllers(trial: Trial, scene: Scene, folder: Path) -> dict[str, Controller]:
    """Return the participants of a trial, and write the leader's path."""
    found = {}
    if trial.path is not None:
        found[LEADER] = Controller(_leader(trial, scene, trial.path, folder), scene.leader.name)
    found[FOLLOWER] = Controller(_follower(trial, scene), scene.follower.name)
    if trial.zoom is not None:
        found[OPERATOR] = Controller(_operator(trial, trial.zoom), role="operator")
    return found


def _leader(trial: Trial, scene: Scene, path: Array, folder: Path) -> Callable[[ProgramContext], Program]:
    robot, pursuit = scene.leader.name, trial.pursuit

    def pursue(context: ProgramContext) -> Program:
        assert pursuit is not None
        body = f"{scene.follower.name}/{pursuit.body}"
        return pursuit_program(context.cell, robot, body, pursuit.speed, ignore)

    def play(context: ProgramContext) -> Program:
        file = folder / "path.csv"
        file.write_text(path_text(scene, path), encoding="utf-8")
        recorded = read_path(file)
        described = check_path(recorded, context.cell.description, robot)
        return PathProgram(Playback(recorded, bounds_of(described)), ignore)

    return play if pursuit is None else pursue


def _follower(trial: Trial, scene: Scene) -> Callable[[ProgramContext], Program]:
    def follow(context: ProgramContext) -> Program:
        options = FollowOptions(trial.distance, trial.lag, focus=trial.focus, predict=trial.predict)
        own, leader = scene.follower.name, scene.leader.name
        return FollowProgram.build(context.cell, own, leader, options, trial.seconds)

    return follow


def _operator(trial: Trial, own: DistanceRange) -> Callable[[ProgramContext], Program]:
    schedule = DistanceSchedule(own.low, own.high, trial.distance, own.rate, trial.seed)
    return lambda _context: ZoomProgram(schedule)
