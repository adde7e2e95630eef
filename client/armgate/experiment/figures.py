"""Figures of one run for the paper's claims, from the observed series."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.stack.metrics import columns
from armgate.apps.stack.observation import Observation
from armgate.experiment.paths import RELEASE_TIME
from armgate.experiment.trials import Trial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED = (0.1, 2e-3)
"""Angle, degrees, and distance error, m, below which an approach has settled."""
QUIET = 2.0
"""Time after the start, repulsion, emergency mode or a limit of the gate that the figures exclude, s."""
LAST = 1.0
"""Length of the end of a run, over which the final errors and motion are taken, s."""


def evaluate(trial: Trial, seen: Observation) -> dict[str, Any]:
    """Return the figures of an experiment, in addition to those of every run."""
    series = columns(seen.rows)
    known = np.isfinite(series["angle_error_rad"])
    series = {name: column[known] for name, column in series.items()}
    positions = np.array(seen.positions)[known]
    if trial.case in ("approach", "limit"):
        return _approach(series, positions)
    if trial.zoom is not None:
        return _zoom(series)
    if trial.case.startswith(("dash", "pursuit")):
        return _dash(series)
    return _tour(series)


def _approach(series: dict[str, Array], positions: Array) -> dict[str, Any]:
    time, angle = series["time_s"], np.degrees(series["angle_error_rad"])
    distance = np.abs(series["distance_error_m"])
    off = np.flatnonzero((angle > SETTLED[0]) | (distance > SETTLED[1]))
    last = int(off[-1]) + 1 if len(off) else 0
    end = time >= time[-1] - LAST
    return {
        "start_angle_deg": float(angle[0]),
        "rise_deg": float((angle - np.minimum.accumulate(angle)).max()),
        "settled_s": float(time[last] - time[0]) if last < len(time) else None,
        "end_angle_deg": float(angle[end].max()),
        "end_distance_m": float(distance[end].max()),
        "end_motion_rad": float(np.ptp(positions[end], axis=0).max()),
    }


def _tour(series: dict[str, Array]) -> dict[str, Any]:
    """Return the RMS angle over a section of the path that is the same for all followers."""
    time, angle = series["time_s"], np.degrees(series["angle_error_rad"])
    moving = (time >= time[0] + QUIET) & (time <= time[-1] - RELEASE_TIME)
    return {"moving_rms_deg": float(np.sqrt(np.mean(angle[moving] ** 2))) if moving.any() else None}


def _zoom(series: dict[str, Array]) -> dict[str, Any]:
    time = series["time_s"]
    after = time >= time[0] + QUIET
    quiet = ~recently(time, series["repulsion"] > 0.0) & after
    distance, angle = np.abs(series["distance_error_m"]), np.degrees(series["angle_error_rad"])
    return {
        "wanted_m": {
            "min": float(series["distance_m"].min()), "max": float(series["distance_m"].max()),
        },
        "quiet_share": float(quiet.sum() / max(1, after.sum())),
        "quiet_distance_m": float(distance[quiet].max(initial=0.0)),
        "zoom_angle_deg": float(angle[after].max()),
        "emergency": bool((series["emergency"] > 0.0).any()),
    }  # fmt: skip


def _dash(series: dict[str, Array]) -> dict[str, Any]:
    time, angle = series["time_s"], np.degrees(series["angle_error_rad"])
    bound = (series["emergency"] > 0.0) | (series["gate_follower"] > 0.0)
    free = ~recently(time, bound) & (time >= time[0] + QUIET)
    return {
        "follower_refused": bool((series["gate_follower"] > 1.0).any()),
        "follower_limited": bool((series["gate_follower"] == 1.0).any()),
        "leader_refused": bool((series["gate_others"] > 1.0).any()),
        "emergency": bool((series["emergency"] > 0.0).any()),
        "repulsion_share": float((series["repulsion"] > 0.0).mean()),
        "free_angle_deg": float(angle[free].max(initial=0.0)),
    }


def recently(time: Array, what: Mask, within: float = QUIET) -> Mask:
    """Return a mask of the times at which a condition holds or has held within the last ``within`` s."""
    last = np.maximum.accumulate(np.where(what, time, -np.inf))
    found: Mask = time - last <= within
    return found
