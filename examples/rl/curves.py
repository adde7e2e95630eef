"""Draw success, and limited or refused steps, of the training runs.

    python curves.py episodes.csv curves.svg

Each point averages the episodes that ended in a window of steps. Lines are means over the seeds; bands
reach from the least to the largest seed.
"""

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from train import EpisodeRow

Array = NDArray[np.float64]

WINDOW = 2000
"""Steps of training that one point averages."""


def read(file: Path) -> list[EpisodeRow]:
    """Read the episodes of all runs."""
    with file.open(encoding="utf-8", newline="") as stream:
        return [
            EpisodeRow(row["reward"], *(int(row[key]) for key in list(row)[1:]))
            for row in csv.DictReader(stream)
        ]


def success(rows: Sequence[EpisodeRow]) -> float:
    """Return the share of episodes that reached their goal."""
    return sum(row.success for row in rows) / len(rows)


def restricted(rows: Sequence[EpisodeRow]) -> float:
    """Return the share of steps in which the gate limited or refused a command."""
    return sum(row.limited + row.refused for row in rows) / sum(row.length for row in rows)


def curve(rows: Iterable[EpisodeRow], measure: Any, window: int = WINDOW) -> tuple[Array, Array]:
    """Return the ends of the windows (k,), steps, and the measure of each seed in each window (seeds, k).

    A window in which no episode of a seed ended is nan.
    """
    found = list(rows)
    ends = np.arange(window, max(row.step for row in found) + window, window)
    seeds = sorted({row.seed for row in found})
    values = np.full((len(seeds), len(ends)), np.nan)
    for i, seed in enumerate(seeds):
        for k, end in enumerate(ends):
            own = [row for row in found if row.seed == seed and end - window < row.step <= end]
            if own:
                values[i, k] = measure(own)
    return ends, values


def draw(rows: Sequence[EpisodeRow], out: Path) -> None:
    """Draw the curves of all rewards."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "armgate"
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    titles = ("goals reached", "steps with a limited or refused command")
    for axis, title, measure in zip(axes, titles, (success, restricted), strict=True):
        for reward in dict.fromkeys(row.reward for row in rows):
            ends, values = curve([row for row in rows if row.reward == reward], measure)
            axis.plot(ends, 100.0 * np.nanmean(values, axis=0), label=reward)
            low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
            axis.fill_between(ends, 100.0 * low, 100.0 * high, alpha=0.2)
        axis.set(title=title, xlabel="steps of training", ylabel="%", ylim=(0, None))
        axis.grid(alpha=0.3)
    axes[0].legend(title="reward")
    figure.savefig(out, metadata={"Date": None})


if __name__ == "__main__":
    draw(read(Path(sys.argv[1])), Path(sys.argv[2]))
