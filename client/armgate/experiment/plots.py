"""Plots as in the paper: angle error, view distance, leader's position, and events."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Series = Mapping[str, Array]

_INK, _WANTED, _BAND = "#1f4e79", "#c77d2e", "#4c9f70"
_STYLE = {
    "figure.dpi": 110, "font.size": 9.5, "lines.linewidth": 1.2, "axes.grid": True, "grid.alpha": 0.25,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left",
    "axes.titleweight": "bold", "legend.frameon": False,
}  # fmt: skip
BEGINNING = 2.0
"""End of the initial phase, s."""
LEAST_ANGLE = 0.05
"""Smallest angle for which the axis is scaled, degrees."""
HIDES = 2.0
"""Ratio by which the largest angle must exceed the scaled axis for the axis to be scaled."""
MARKERS = (
    ("near_limit", 0.5, "joint near its limit", "#8e6bbf"),
    ("repulsion", 0.5, "repulsion", "#d9a520"),
    ("emergency", 0.5, "emergency mode", "#c0392b"),
    ("gate_follower", 0.5, "gate limits the follower", "#34495e"),
    ("gate_others", 0.5, "gate limits the leader", "#95a5a6"),
)
"""Column, threshold, text and colour of the events that are marked below the curves."""


def draw(file: Path, title: str, runs: Sequence[Series]) -> None:
    """Draw one picture of one run, or of several runs in one plot (then without events).

    Args:
        file: PNG to write.
        title: Title of the picture.
        runs: Columns of the observation by name.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    alone = len(runs) == 1
    with mpl.rc_context(_STYLE):
        figure, axes = plt.subplots(
            4 if alone else 2, 1, figsize=(8.0, 7.2 if alone else 4.8), sharex=True, layout="constrained",
            height_ratios=(3, 3, 3, 1.5) if alone else (1, 1),
        )  # fmt: skip
        axes[0].set_title(title)
        for run in runs:
            _angle(axes[0], run)
            _distance(axes[1], run, alone)
        axes[0].set_ylim(bottom=0.0)
        if alone:
            _enlarge(axes[0], runs[0])
            _place(axes[2], runs[0])
            _markers(axes[3], runs[0])
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(0.0, max(float(run["time_s"][-1]) for run in runs))
        figure.savefig(file)
        plt.close(figure)


def _angle(axes: Any, run: Series) -> None:
    axes.plot(run["time_s"], np.degrees(run["angle_error_rad"]), color=_INK, alpha=0.85)
    axes.set_ylabel("angle error [°]")


def _enlarge(axes: Any, run: Series) -> None:
    """Scale the axis to the later angles if the initial one is far larger; print the latter as text."""
    angle = np.degrees(run["angle_error_rad"])
    later = angle[(run["time_s"] >= BEGINNING) & np.isfinite(angle)]
    top = 1.4 * max(float(later.max(initial=0.0)), LEAST_ANGLE)
    if len(later) and np.nanmax(angle) > HIDES * top:
        axes.set_ylim(top=top)
        text = f"initially up to {np.nanmax(angle):.1f}°"
        axes.text(0.12, 0.85, text, transform=axes.transAxes, fontsize=8, color="#555")


def _distance(axes: Any, run: Series, alone: bool) -> None:
    axes.plot(
        run["time_s"], run["distance_m"] + run["distance_error_m"], color=_INK, alpha=0.85, label="‖x − p‖"
    )
    if alone:
        axes.plot(run["time_s"], run["distance_m"], color=_WANTED, ls="--", lw=1.0, label="wanted")
        axes.legend(loc="best", ncols=2)
    axes.set_ylabel("view distance [m]")


def _place(axes: Any, run: Series) -> None:
    for axis, colour in zip("xyz", ("#c0392b", "#2e8b57", "#1f4e79"), strict=True):
        column = run[f"leader_{axis}_m"]
        known = column[np.isfinite(column)]
        axes.plot(run["time_s"], column - (known[0] if len(known) else 0.0), color=colour, label=axis)
    axes.set_ylabel("leader's tool from\nits start [m]")
    axes.legend(loc="best", ncols=3)


def _markers(axes: Any, run: Series) -> None:
    names = [name for _, _, name, _ in MARKERS]
    for row, (column, threshold, _, colour) in enumerate(MARKERS):
        time = run["time_s"][run[column] > threshold]
        axes.plot(time, np.full(len(time), row), ls="", marker="|", ms=7, color=colour)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(labelsize=8)
