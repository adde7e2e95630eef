"""Trials of experiments in the pools of `armgate.campaign`: each runs in a world and has a folder."""

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armgate.apps.errors import AppError, UsageError
from armgate.campaign.basis import versions
from armgate.campaign.drive import MakePool, MissingTrials
from armgate.campaign.result import Result, failed
from armgate.campaign.store import Store
from armgate.campaign.table import result_of
from armgate.campaign.trials import KEY_DIGITS, canonical
from armgate.campaign.trials import Trial as StoredTrial
from armgate.cell.compilation import announced
from armgate.experiment.experiment_file import Experiment
from armgate.experiment.scene import Scene, build_scene
from armgate.experiment.trials import Trial
from armgate.experiment.world_trial import METRICS, SERIES, play_in_world

TIMEOUT = 600.0
"""Longest time of a trial, s."""


@dataclass(frozen=True, slots=True)
class PlannedTrial(StoredTrial):
    """Trial of an experiment, as workers receive it.

    Attributes:
        run: The trial.
        folder: Folder of its results.
    """

    run: Trial
    folder: Path

    @property
    def done(self) -> bool:
        """True if its folder holds its series and figures; figures torn by a power failure do not count."""
        try:
            read_entry(self)
        except (OSError, ValueError):
            return False
        return (self.folder / SERIES).is_file()


@dataclass(frozen=True)
class LabPlan:
    """Plan of the workers, see `armgate.campaign.pool.Plan`.

    Attributes:
        configs: Configuration files of the cell.
        timeout: Longest time of a trial, s.
    """

    configs: tuple[Path, ...]
    timeout: float = TIMEOUT

    def laboratory(self) -> "TrialLab":
        """Return the runner of the trials."""
        return TrialLab(build_scene(self.configs))


class TrialLab:
    """Runner of trials in one process.

    Args:
        scene: The cell.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def run(self, trial: StoredTrial) -> Result:
        """Run a trial and write its folder, which is emptied before; an error is a failed result."""
        assert isinstance(trial, PlannedTrial)
        try:
            shutil.rmtree(trial.folder, ignore_errors=True)
            entry = play_in_world(trial.run, self._scene, trial.folder, record=True)
        except Exception as error:
            return failed(trial.key, error)
        return Result(trial.key, figures=dict(flat(entry)))


def flat(entry: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield the numbers of nested figures, such as ``angle_error_deg.max``."""
    for name, value in entry.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
        elif isinstance(value, bool | int | float):
            yield f"{prefix}{name}", float(value)


def plan_trials(experiment: str, trials: Sequence[Trial], folder: Path) -> list[PlannedTrial]:
    """Return the trials of an experiment with their keys; ``folder`` is that of the whole campaign."""
    here = folder / experiment
    return [
        PlannedTrial(
            _key(experiment, trial), experiment, trial.case, trial.seed, (), trial, here / trial.name
        )
        for trial in trials
    ]  # fmt: skip


def _key(experiment: str, trial: Trial) -> str:
    """Return the hash of everything that determines a trial in its cell."""
    content = {
        name: value.tolist() if hasattr(value, "tolist") else value and getattr(value, "__dict__", value)
        for name, value in vars(trial).items()
    }
    return hashlib.sha256(canonical({"experiment": experiment, **content})).hexdigest()[:KEY_DIGITS]


def run_in_worlds(
    trials: Sequence[PlannedTrial],
    setups: Mapping[str, Experiment],
    scene: Scene,
    folder: Path,
    make_pool: MakePool,
) -> tuple[dict[str, Result], bool]:
    """Run the trials that the folder does not hold yet, in the workers of a pool.

    Returns:
        The results by key, and True if the user interrupted the run.

    Raises:
        UsageError: The folder holds results of other experiments, or another process uses it.
        CampaignError: The disk is full, or the workers are lost; the results so far are stored.
    """
    with Store(folder, _manifest(trials, setups, scene)) as store:
        missing = [trial for trial in trials if trial.key not in store or not _complete(trial, store)]
        interrupted = MissingTrials(missing, len(trials), LabPlan(scene.configs)).run(store, make_pool)
        return {key: result_of(row) for key, row in store.rows.items()}, interrupted


def _complete(trial: PlannedTrial, store: Store) -> bool:
    """Return True if a stored trial needs no further run; one that failed is run again."""
    return trial.done and not result_of(store.rows[trial.key]).failed


def _manifest(
    trials: Sequence[PlannedTrial], setups: Mapping[str, Experiment], scene: Scene
) -> Mapping[str, Any]:
    return {
        "experiments": {name: setup.model_dump(mode="json") for name, setup in setups.items()},
        "trials": len(trials),
        "cell": scene.cell_hash,
        "versions": versions(),
    }


def read_entry(trial: PlannedTrial) -> dict[str, Any]:
    """Return the figures of a trial that has been run."""
    entry: dict[str, Any] = json.loads((trial.folder / METRICS).read_text(encoding="utf-8"))
    return entry


def repeat(trials: Sequence[PlannedTrial], name: str, scene: Scene, folder: Path) -> Iterator[str]:
    """Run one trial again, in ``folder/trials``, and yield lines about it.

    Raises:
        UsageError: There is no trial with this name.
        AppError: The trial failed, or it differs from the run in the folder of the campaign.
    """
    found = [trial for trial in trials if trial.run.name == name]
    if not found:
        some = ", ".join(trial.run.name for trial in trials[:3])
        raise UsageError(f"--trial {name}: there is no such trial; expected one such as {some}")
    where = folder / "trials" / name
    shutil.rmtree(where, ignore_errors=True)
    with announced():
        play_in_world(found[0].run, scene, where, record=True)
    yield f"{where}: recording, series.csv and metrics.json; explain it with: armgate explain {where}"
    before = found[0]
    if not before.done:
        yield f"there is no run in {before.folder} to compare with"
        return
    for file in (SERIES, METRICS):
        if (where / file).read_bytes() != (before.folder / file).read_bytes():
            raise AppError(f"{where / file}: differs from that of the run in {before.folder}")
    yield f"series and figures equal those in {before.folder}, byte for byte"
