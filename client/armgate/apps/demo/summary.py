"""Summary of a run, printed at its end."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from armgate.apps.stack.metrics import ANGLE_BAND, DISTANCE_BAND

_VERDICT = {
    True: ("holds", "bold green"),
    False: ("does not hold", "bold red"),
    None: ("too short to decide", "yellow"),
}


def summary(metrics: Mapping[str, Any], folder: Path, pictures: Sequence[Path]) -> RenderableType:
    """Return the demo's claims with their figures, the verdicts, and the location of the files."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    for claim, holds, figure in _claims(metrics):
        table.add_row(claim, Text(*_VERDICT[holds]), figure)
    robots = [
        Text(f"{robot}: {_sentence(verdicts, metrics['ticks'][robot])}")
        for robot, verdicts in metrics["verdicts"].items()
    ]
    notes = [Text(text, style="yellow") for text in _notes(metrics)]
    written = (
        f"{folder}: metrics.json, series.csv, {len(pictures)} pictures, recording, configuration and logs"
    )
    monitor = [Text(f"monitor: {metrics['monitor']['summary']}")] if metrics.get("monitor") else []
    return Group(Text(), table, *robots, *monitor, _pace(metrics), *notes, Text(written, style="dim"))


def _claims(metrics: Mapping[str, Any]) -> list[tuple[str, bool | None, str]]:
    holds = metrics["holds"]
    angle, distance = metrics["angle_error_deg"], metrics["distance_error_m"]
    clearance = metrics["min_clearance_m"]
    nearest = "" if not metrics["nearest_pair"] else ", {} – {}".format(*metrics["nearest_pair"])
    return [
        (f"view angle within ± {ANGLE_BAND:g}°", holds["angle"], _errors(angle, 1, "°", 2)),
        (
            f"view distance within ± {100 * DISTANCE_BAND:g} cm", holds["distance"],
            _errors(distance, 1000, " mm", 1),
        ),
        (
            f"clearance of at least {1000 * metrics['stop_distance_m']:.0f} mm", holds["clearance"],
            "" if clearance is None else f"smallest {1000 * clearance:.0f} mm{nearest}",
        ),
        ("every command in time", holds["in_time"], f"{metrics['late_commands']} late"),
    ]  # fmt: skip


def _errors(errors: Mapping[str, float | None], scale: float, unit: str, digits: int) -> str:
    if errors["max"] is None or errors["rms"] is None:
        return ""
    return f"max {scale * errors['max']:.{digits}f}{unit}, rms {scale * errors['rms']:.{digits}f}{unit}"


def _sentence(verdicts: Mapping[str, Any], ticks: int) -> str:
    words = [f"{ticks} ticks: {verdicts['admitted']} commands admitted"]
    for outcome in ("limited", "refused"):
        reasons = ", ".join(f"{name} {number}" for name, number in verdicts[outcome].items())
        words.append(f"{sum(verdicts[outcome].values())} {outcome}" + (f" ({reasons})" if reasons else ""))
    return ", ".join(words)


def _pace(metrics: Mapping[str, Any]) -> Text:
    factor = metrics["realtime_factor"]
    return Text(f"{metrics['duration_s']:.1f} s" + (f" at {factor:.2f} × real time" if factor else ""))


def _notes(metrics: Mapping[str, Any]) -> list[str]:
    notes = list(metrics["warnings"])
    if not metrics["complete"]:
        notes.append("the run ended early: the figures cover only the part that was observed")
    notes += [
        f"{number} states of {robot} were not observed; the figures do not cover them"
        for robot, number in metrics["states_missed"].items()
    ]
    return notes
