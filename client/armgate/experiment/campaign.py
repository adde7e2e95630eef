"""Campaign: run experiments in worlds or over sockets, then write figures, pictures and pages."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from armgate.apps.errors import AppError
from armgate.apps.stack.fork_server import ForkServer
from armgate.apps.stack.run_folder import write_metrics
from armgate.campaign.local_pool import LocalPool
from armgate.campaign.result import Result
from armgate.experiment.claims import Claim, aggregate, claims
from armgate.experiment.experiment_file import Experiment
from armgate.experiment.lab import PlannedTrial, plan_trials, read_entry, repeat, run_in_worlds
from armgate.experiment.plots import Array, draw
from armgate.experiment.progress import Progress, progress
from armgate.experiment.report import page
from armgate.experiment.scene import Scene
from armgate.experiment.trial_run import play
from armgate.experiment.trials import Trial, trials

_WORDS = {True: ("holds", "green"), False: ("does not hold", "bold red"), None: ("–", "dim")}
_TOGETHER = ("approach", "limit")
"""Cases whose runs are drawn in one picture, as in the paper."""


@dataclass(frozen=True)
class Options:
    """Options of a campaign.

    Attributes:
        seeds: Number of leader paths or starts; None for the number in the experiment's file.
        realtime: True to run by the wall clock instead of in lock-step.
        sockets: True to run all programs as processes, also in lock-step, instead of in worlds.
        jobs: Number of worker processes for runs in worlds.
    """

    seeds: int | None = None
    realtime: bool = False
    sockets: bool = False
    jobs: int = 1


@dataclass
class ExperimentRuns:
    """Runs of one experiment so far.

    Attributes:
        planned: Number of planned runs.
        entries: Figures of the finished runs.
        failed: Reason why runs are missing; "" if the experiment is complete or was interrupted.
    """

    planned: int
    entries: list[dict[str, Any]] = field(default_factory=list)
    failed: str = ""

    @property
    def complete(self) -> bool:
        """Return True if all runs are finished."""
        return len(self.entries) == self.planned

    @property
    def ended(self) -> str:
        """Reason why runs are missing; "" if the experiment is complete."""
        if self.complete:
            return ""
        return f"{len(self.entries)} of {self.planned} runs, then: {self.failed or 'interrupted'}"


@dataclass
class Campaign:
    """Experiments in one folder; finished runs are evaluated and written even after a failure.

    Attributes:
        scene: The cell.
        folder: Folder for all results.
        options: Options of the campaign.
        found: Claims of the experiments so far.
    """

    scene: Scene
    folder: Path
    options: Options
    found: dict[str, list[Claim]] = field(default_factory=dict)

    def run(self, setups: Mapping[str, Experiment]) -> str:
        """Run the experiments; return the reason why runs are missing, or "".

        Raises:
            CampaignError: The workers or the disk failed; the results so far are stored.
        """
        over_sockets = self.options.sockets or self.options.realtime
        ended = self._over_sockets(setups) if over_sockets else self._in_worlds(setups)
        self._sum_up(ended)
        return ended

    def _over_sockets(self, setups: Mapping[str, Experiment]) -> str:
        """Run the experiments one after the other, each program as a process."""
        fork_server = ForkServer()
        fork_server.warm()
        runs = ExperimentRuns(0)
        with progress() as bar:
            for name, setup in setups.items():
                runs = self._experiment(name, setup, fork_server, bar)
                if not runs.complete:
                    break
        return runs.ended

    def _in_worlds(self, setups: Mapping[str, Experiment]) -> str:
        """Run the trials of all experiments in worlds, in the processes of a pool."""
        planned = self._planned(setups)
        todo = [trial for trials in planned.values() for trial in trials]
        results, _ = run_in_worlds(
            todo, setups, self.scene, self.folder, lambda plan: LocalPool(plan, self.options.jobs)
        )
        ends = []
        for name, setup in setups.items():
            runs = _runs(planned[name], results)
            self.found[name] = claims(name, runs.entries)
            self._write(name, setup, runs)
            ends.append(runs.ended)
        return next(filter(None, ends), "")

    def repeat(self, setups: Mapping[str, Experiment], name: str) -> Iterator[str]:
        """Run one trial again in a world, record it, and yield lines about it.

        Raises:
            UsageError: There is no trial with this name.
            AppError: The trial failed, or it differs from the run in the folder.
        """
        todo = [trial for trials in self._planned(setups).values() for trial in trials]
        yield from repeat(todo, name, self.scene, self.folder)

    def _planned(self, setups: Mapping[str, Experiment]) -> dict[str, list[PlannedTrial]]:
        return {
            name: plan_trials(name, trials(setup, self.scene, self.options.seeds), self.folder)
            for name, setup in setups.items()
        }

    def _sum_up(self, ended: str) -> None:
        rows = [{"experiment": name, **claim.row()} for name, rows in self.found.items() for claim in rows]
        broken = any(row["holds"] is False for row in rows)
        holds = False if broken else None if ended else True
        write_metrics(self.folder, {"complete": not ended, "ended": ended, "holds": holds, "claims": rows})

    def _experiment(
        self, name: str, setup: Experiment, fork_server: ForkServer, bar: Progress
    ) -> ExperimentRuns:
        todo = trials(setup, self.scene, self.options.seeds)
        runs = ExperimentRuns(len(todo))
        bar.begin(name, len(todo))
        try:
            self._play(name, todo, runs, fork_server, bar)
        except AppError as error:
            runs.failed = str(error)
        except KeyboardInterrupt:  # between two runs; during a run it is an event
            pass
        self.found[name] = claims(name, runs.entries)
        self._write(name, setup, runs)
        return runs

    def _play(
        self, name: str, todo: Sequence[Trial], runs: ExperimentRuns, fork_server: ForkServer, bar: Progress
    ) -> None:
        for trial in todo:
            folder = self.folder / name / trial.name
            entry = play(
                trial, self.scene, folder, fork_server, realtime=self.options.realtime, show=bar.show
            )
            if entry is None:
                return
            runs.entries.append(entry)
            bar.done(trial.name, entry)

    def _write(self, name: str, setup: Experiment, runs: ExperimentRuns) -> None:
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        sums, found = aggregate(runs.entries), self.found[name]
        write_metrics(
            folder,
            {
                "experiment": name, "realtime": self.options.realtime, "ended": runs.ended,
                "setup": setup.model_dump(mode="json"), "entries": runs.entries,
                "aggregate": sums, "claims": [claim.row() for claim in found],
            },
        )  # fmt: skip
        pictures = list(_pictures(folder, runs.entries))
        text = page(name, found, sums, pictures, ended=runs.ended)
        (folder / "report.html").write_text(text, encoding="utf-8")

    def tables(self) -> list[Table]:
        """Return the claims as tables for a terminal."""
        return [_table(name, rows) for name, rows in self.found.items()]


def _runs(planned: Sequence[PlannedTrial], results: Mapping[str, Result]) -> ExperimentRuns:
    """Return the runs of an experiment, from the results of its trials and the figures in their folders."""
    runs = ExperimentRuns(len(planned))
    for trial in planned:
        result = results.get(trial.key)
        if result is not None and result.failed:
            runs.failed = runs.failed or f"{trial.run.name}: {result.reason}"
        elif result is not None:
            runs.entries.append(read_entry(trial))
    return runs


def _pictures(folder: Path, entries: Sequence[Mapping[str, Any]]) -> list[tuple[str, Path]]:
    found = []
    for case in dict.fromkeys(entry["case"] for entry in entries):
        names = [f"{case}-{entry['seed']}" for entry in entries if entry["case"] == case]
        shown = names if case in _TOGETHER else names[:1]
        caption = f"{case}: {len(shown)} runs" if len(shown) > 1 else shown[0]
        file = folder / f"{case}.png"
        draw(file, caption, [read_series(folder / name) for name in shown])
        found.append((caption, file))
    return found


def read_series(folder: Path) -> dict[str, Array]:
    """Return the columns of a run's ``series.csv``."""
    with (folder / "series.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    table = np.array(rows, dtype=float).reshape(len(rows), len(head))
    return dict(zip(head, table.T, strict=True))


def _table(name: str, rows: Sequence[Claim]) -> Table:
    table = Table(title=name, title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    for head in ("claim", "goal", "armgate", ""):
        table.add_column(head, header_style="dim")
    for claim in rows:
        table.add_row(claim.claim, claim.goal, claim.text, Text(*_WORDS[claim.holds]))
    return table
