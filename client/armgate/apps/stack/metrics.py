"""The figures of a run, and whether it kept what the demo promises."""

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
"""How long the angle error has to stay in its band for the transient to be over, s."""
LONGEST_TRANSIENT = 5.0
"""After this time the transient counts as over in any case, s."""
_JUDGED = ("states", "positions", "missed", "violations", "findings", "smallest", "summary")
"""What of the monitor's account goes into the metrics."""


def columns(rows: list[tuple[float, ...]]) -> dict[str, Array]:
    """The series as arrays by column name."""
    table = np.array(rows, dtype=float).reshape(len(rows), len(COLUMNS))
    return dict(zip(COLUMNS, table.T, strict=True))


def transient_end(time: Array, angle: Array) -> float:
    """The time at which the approach is over, s.

    That is once the angle error (rad, NaN before the follower's first) has been within the band for 1 s, and
    5 s after its first value at the latest. Infinite without any value.
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
    """Largest magnitude and root mean square of the finite values; None where there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {"max": None, "rms": None}
    return {"max": float(np.max(np.abs(values))), "rms": float(np.sqrt(np.mean(values**2)))}


def verdict_table(counts: Mapping[str, int]) -> dict[str, Any]:
    """Verdicts by outcome and, by reason unless admitted, from counts like ``refused:clearance``."""
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
    judged: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The content of ``metrics.json``.

    Args:
        seen: What was observed.
        stop_distance: The distance that the gate keeps to others and surroundings, m.
        wall: Time that passed by the wall clock while the states were observed, s.
        complete: Whether the path was run to its end.
        judged: What the monitor wrote.
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
        "monitor": None if judged is None else {key: judged[key] for key in _JUDGED},
    }
    metrics["holds"] = promises(metrics)
    return metrics


def promises(metrics: Mapping[str, Any]) -> dict[str, bool | None]:
    """Which of the demo's promises were kept; None where the run was too short to tell."""
    angle, distance = metrics["angle_error_deg"]["max"], metrics["distance_error_m"]["max"]
    clearance = metrics["min_clearance_m"]
    return {
        "angle": None if angle is None else angle <= ANGLE_BAND,
        "distance": None if distance is None else distance <= DISTANCE_BAND,
        "clearance": None if clearance is None else clearance >= metrics["stop_distance_m"],
        "in_time": metrics["late_commands"] == 0,
    }
