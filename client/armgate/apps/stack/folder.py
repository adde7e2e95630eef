"""The folder of one run: configuration, logs, series, metrics, pictures."""

import csv
import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from armgate.apps.errors import UsageError
from armgate.apps.stack.observation import COLUMNS


def make_folder(wanted: Path | None) -> Path:
    """Makes the run's folder, ``runs/<local time>`` unless one is wanted, with a place for logs.

    Raises:
        UsageError: It cannot be made.
    """
    folder = wanted or Path("runs") / datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
    try:
        (folder / "logs").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be made ({error.strerror}); name another with --out") from error
    return folder


def write_series(folder: Path, rows: list[tuple[float, ...]]) -> None:
    """Writes what the plots show as ``series.csv``."""
    with (folder / "series.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        table.writerows([f"{value:.9g}" for value in row] for row in rows)


def write_metrics(folder: Path, metrics: Mapping[str, Any]) -> None:
    """Writes ``metrics.json``."""
    text = json.dumps(metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
