"""Plots of a run as PNG: the paper's plots, with the error bands of the claims."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.stack.metrics import ANGLE_BAND, DISTANCE_BAND

Array = NDArray[np.float64]

_INK, _BAND, _SHADE, _WARN = "#1f4e79", "#4c9f70", "#9aa5b1", "#c0392b"
_STYLE = {
    "figure.figsize": (9.0, 4.2), "figure.dpi": 120, "font.size": 10.0, "lines.linewidth": 1.3,
    "axes.grid": True, "grid.alpha": 0.25, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlelocation": "left", "axes.titleweight": "bold", "legend.frameon": False,
}  # fmt: skip


def draw(series: Mapping[str, Array], metrics: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw all plots of a run.

    Args:
        series: Columns of the observation by name.
        metrics: The content of ``metrics.json``.
        folder: Folder for the pictures.

    Returns:
        The pictures that were written; none for an empty series.
    """
    if not len(series["time_s"]):
        return []
    import matplotlib as mpl

    mpl.use("Agg")
    figures = {
        "angle_error": _angle, "distance_error": _distance,
        "leader_position": _position, "clearance": _clearance,
    }  # fmt: skip
    with mpl.rc_context(_STYLE):
        return [_figure(folder / f"{name}.png", paint, series, metrics) for name, paint in figures.items()]


def _figure(file: Path, paint: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> Path:
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(layout="constrained")
    paint(axes, series, metrics)
    axes.set_xlabel("time [s]")
    axes.set_xlim(float(series["time_s"][0]), max(float(series["time_s"][-1]), 0.1))
    figure.savefig(file)
    plt.close(figure)
    return file


def _shade_transient(axes: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> None:
    """Shade the transient, to which the bands do not apply."""
    end = metrics["transient_s"]
    until = float(series["time_s"][-1]) if end is None else end
    axes.axvspan(float(series["time_s"][0]), until, color=_SHADE, alpha=0.18, lw=0, label="approach")


def _band(axes: Any, low: float, high: float, label: str) -> None:
    axes.axhspan(low, high, color=_BAND, alpha=0.12, lw=0)
    for edge in {low, high} - {0.0}:
        axes.axhline(edge, color=_BAND, lw=1.0, ls="--", label=label if edge == high else None)


def _focus_on(axes: Any, values: Array, after: NDArray[np.bool_], band: float, lowest: float) -> None:
    """Scale the axis to the values after the transient; the transient may be clipped at the top."""
    settled = values[after & np.isfinite(values)]
    reach = max(1.6 * band, 1.15 * float(np.max(np.abs(settled), initial=0.0)))
    axes.set_ylim(lowest * reach, reach)


def _angle(axes: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> None:
    angle = np.degrees(series["angle_error_rad"])
    _shade_transient(axes, series, metrics)
    _band(axes, 0.0, ANGLE_BAND, f"± {ANGLE_BAND:g}°")
    axes.plot(series["time_s"], angle, color=_INK, label="view angle")
    _focus_on(axes, angle, _after(series, metrics), ANGLE_BAND, 0.0)
    axes.set_ylabel("angle error [°]")
    axes.set_title(
        "Angle between the camera's axis and the leader's tool" + _figures(metrics["angle_error_deg"], "°", 1)
    )
    axes.legend(loc="upper right", ncols=3)


def _distance(axes: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> None:
    error = 1000 * series["distance_error_m"]
    band = 1000 * DISTANCE_BAND
    _shade_transient(axes, series, metrics)
    _band(axes, -band, band, f"± {band:g} mm")
    axes.plot(series["time_s"], error, color=_INK, label="view distance")
    _focus_on(axes, error, _after(series, metrics), band, -1.0)
    axes.set_ylabel("distance error [mm]")
    axes.set_title(
        "View distance minus wanted view distance" + _figures(metrics["distance_error_m"], " mm", 1000)
    )
    axes.legend(loc="upper right", ncols=3)


def _position(axes: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> None:
    for axis, colour in zip("xyz", ("#c0392b", "#2e8b57", "#1f4e79"), strict=True):
        axes.plot(series["time_s"], series[f"focus_{axis}_m"], color=colour, label=axis)
    _shade_transient(axes, series, metrics)
    axes.set_ylabel("position [m]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.15 * (high - low))  # room for the legend
    axes.set_title("The leader's tool in the world frame, as measured")
    axes.legend(loc="upper right", ncols=4)


def _clearance(axes: Any, series: Mapping[str, Array], metrics: Mapping[str, Any]) -> None:
    stop, least = 1000 * metrics["stop_distance_m"], metrics["min_clearance_m"]
    axes.axhspan(0.0, stop, color=_WARN, alpha=0.10, lw=0)
    axes.axhline(stop, color=_WARN, lw=1.0, ls="--", label=f"stop distance {stop:g} mm")
    axes.plot(series["time_s"], 1000 * series["clearance_m"], color=_INK, label="nearest pair")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("clearance [mm]")
    least_text = "" if least is None else f" — at least {1000 * least:.0f} mm"
    axes.set_title(f"Certified clearance between robots and to the surroundings{least_text}")
    axes.legend(loc="upper right", ncols=2)


def _after(series: Mapping[str, Array], metrics: Mapping[str, Any]) -> NDArray[np.bool_]:
    end = metrics["transient_s"]
    after: NDArray[np.bool_] = series["time_s"] >= (np.inf if end is None else end)
    return after


def _figures(errors: Mapping[str, float | None], unit: str, scale: float) -> str:
    if errors["max"] is None or errors["rms"] is None:
        return ""
    return f" — max {scale * errors['max']:.2g}{unit}, rms {scale * errors['rms']:.2g}{unit}"
