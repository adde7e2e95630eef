"""Experiments one after the other: all their runs, then figures, pictures and pages."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from armgate.apps.experiment.claims import Claim, aggregate, claims
from armgate.apps.experiment.plots import Array, draw
from armgate.apps.experiment.progress import Progress, progress
from armgate.apps.experiment.report import page
from armgate.apps.experiment.scene import Scene
from armgate.apps.experiment.setup import Experiment
from armgate.apps.experiment.stack import play
from armgate.apps.experiment.trials import trials
from armgate.apps.stack.folder import write_metrics
from armgate.apps.stack.nursery import Nursery

_WORDS = {True: ("holds", "green"), False: ("does not hold", "bold red"), None: ("–", "dim")}
_TOGETHER = ("approach", "limit")
"""Cases whose runs are drawn one over the other, as the paper does."""


@dataclass(frozen=True)
class Options:
    """How to run: how many seeds (None: as the file says), and whether by the clock."""

    seeds: int | None = None
    realtime: bool = False


@dataclass
class Campaign:
    """Some experiments in one folder.

    Attributes:
        scene: The cell.
        folder: Where everything goes.
        options: How to run.
        found: Claims of the experiments that were run.
    """

    scene: Scene
    folder: Path
    options: Options
    found: dict[str, list[Claim]] = field(default_factory=dict)

    def run(self, setups: Mapping[str, Experiment]) -> bool:
        """Runs them; False if somebody asked to end before all was run.

        Raises:
            AppError: A process died or never became ready.
        """
        nursery = Nursery()
        nursery.warm()
        complete = True
        with progress() as bar:
            for name, setup in setups.items():
                complete = complete and self._experiment(name, setup, nursery, bar)
        rows = [{"experiment": name, **claim.row()} for name, rows in self.found.items() for claim in rows]
        holds = all(row["holds"] is not False for row in rows)
        write_metrics(self.folder, {"complete": complete, "holds": holds, "claims": rows})
        return complete

    def _experiment(self, name: str, setup: Experiment, nursery: Nursery, bar: Progress) -> bool:
        folder = self.folder / name
        todo = trials(setup, self.scene, self.options.seeds)
        entries: list[dict[str, Any]] = []
        bar.begin(name, len(todo))
        for trial in todo:
            entry = play(
                trial, self.scene, folder / trial.name, nursery,
                realtime=self.options.realtime, show=bar.show,
            )  # fmt: skip
            if entry is None:
                break
            entries.append(entry)
            bar.done(trial.name, entry)
        self.found[name] = claims(name, entries)
        self._write(name, setup, entries)
        return len(entries) == len(todo)

    def _write(self, name: str, setup: Experiment, entries: Sequence[dict[str, Any]]) -> None:
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        sums, found = aggregate(entries), self.found[name]
        write_metrics(
            folder,
            {
                "experiment": name, "realtime": self.options.realtime,
                "setup": setup.model_dump(mode="json"), "entries": list(entries),
                "aggregate": sums, "claims": [claim.row() for claim in found],
            },
        )  # fmt: skip
        pictures = list(_pictures(folder, entries))
        (folder / "report.html").write_text(page(name, found, sums, pictures), encoding="utf-8")

    def tables(self) -> list[Table]:
        """The claims, for a terminal."""
        return [_table(name, rows) for name, rows in self.found.items()]


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
    """The columns of a run's ``series.csv``."""
    with (folder / "series.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    table = np.array(rows, dtype=float).reshape(len(rows), len(head))
    return dict(zip(head, table.T, strict=True))


def _table(name: str, rows: Sequence[Claim]) -> Table:
    table = Table(title=name, title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    for head in ("claim", "goal", "worst", ""):
        table.add_column(head, header_style="dim")
    for claim in rows:
        value = "–" if claim.value is None else f"{claim.value:.3g} {claim.unit}"
        table.add_row(claim.claim, claim.goal, value, Text(*_WORDS[claim.holds]))
    return table
