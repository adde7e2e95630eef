"""Figures of a run, and checks of the demo's claims."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.stack.observation import COLUMNS, Observation

Array = NDArray[np.float64]

ANGLE_BAND = 1.0
"""Largest view-angle error after the transient, degrees."""
DISTANCE_BAND = 0.02
"""Largest error of the view distance after the transient, m."""
SETTLED = 1.0
"""Time for which the angle error must stay in its band before the transient is over, s."""
LONGEST_TRANSIENT = 5.0
"""Time after which the transient counts as over in any case, s."""
_REPORTED = ("states", "positions", "missed", "violations", "findings", "smallest", "summary")
"""Keys of the monitor's report that go into the metrics."""


def columns(rows: list[tuple[float, ...]]) -> dict[str, Array]:
    """Return the series as arrays by column name."""
    table = np.array(rows, dtype=float).reshape(len(rows), len(COLUMNS))
    return dict(zip(COLUMNS, table.T, strict=True))


def transient_end(time: Array, angle: Array) -> float:
    """Return the time at which the transient is over, s.

    The transient ends when the angle error (rad, NaN before the follower's first value) has been within the
    band for 1 s, and at the latest 5 s after its first value. The result is infinite without any value.
    """
    known = np.isfinite(angle)
    if not known.any():
        return float("inf")
    time, inside = time[known], np.degrees(np.abs(angle[known])) <= ANGLE_BAND
    since = time[0]
    for t, ok in zip(time, inside, strict=True):
        if not ok:
            since = t
        elif t - since >= SETTLED:
            return float(t)
        if t - time[0] >= LONGEST_TRANSIENT:
            return float(t)
    return float("inf")


def extremes(values: Array) -> dict[str, float | None]:
    """Return the largest magnitude and the root mean square of the finite values; None without values."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {"max": None, "rms": None}
    return {"max": float(np.max(np.abs(values))), "rms": float(np.sqrt(np.mean(values**2)))}


def verdict_table(counts: Mapping[str, int]) -> dict[str, Any]:
    """Return verdicts by outcome and, unless admitted, reason, from counts such as ``refused:clearance``."""
    table: dict[str, Any] = {"admitted": 0, "limited": {}, "refused": {}}
    for key, number in sorted(counts.items()):
        outcome, _, reason = key.partition(":")
        if outcome == "admitted":
            table["admitted"] += number
        else:
            table[outcome][reason or "unknown"] = number
    return table


def compute(
    seen: Observation,
    stop_distance: float,
    wall: float,
    complete: bool,
    report: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of ``metrics.json``.

    Args:
        seen: The observation.
        stop_distance: Distance that the gate keeps to other robots and surroundings, m.
        wall: Wall-clock time during which states were observed, s.
        complete: True if the path was played to its end.
        report: Report of the monitor.
    """
    series = columns(seen.rows)
    over = transient_end(series["time_s"], series["angle_error_rad"])
    after = series["time_s"] >= over
    metrics: dict[str, Any] = {
        "complete": complete,
        "duration_s": seen.elapsed,
        "transient_s": over if np.isfinite(over) else None,
        "angle_error_deg": extremes(np.degrees(series["angle_error_rad"][after])),
        "distance_error_m": extremes(series["distance_error_m"][after]),
        "min_clearance_m": seen.least_clearance,
        "nearest_pair": list(seen.nearest[1]) if seen.nearest else None,
        "stop_distance_m": stop_distance,
        "late_commands": seen.late_commands,
        "verdicts": {entry.robot: verdict_table(entry.counts or {}) for entry in seen.entries},
        "ticks": seen.ticks,
        "realtime_factor": seen.elapsed / wall if wall > 0.0 else None,
        "states_missed": seen.missed,
        "warnings": seen.warnings,
        "monitor": None if report is None else {key: report[key] for key in _REPORTED},
    }
    metrics["holds"] = check_claims(metrics)
    return metrics


def check_claims(metrics: Mapping[str, Any]) -> dict[str, bool | None]:
    """Return the demo's claims that hold; None if the run was too short to decide."""
    angle, distance = metrics["angle_error_deg"]["max"], metrics["distance_error_m"]["max"]
    clearance = metrics["min_clearance_m"]
    return {
        "angle": None if angle is None else angle <= ANGLE_BAND,
        "distance": None if distance is None else distance <= DISTANCE_BAND,
        "clearance": None if clearance is None else clearance >= metrics["stop_distance_m"],
        "in_time": metrics["late_commands"] == 0,
    }
