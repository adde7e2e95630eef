"""The folder of one run: configuration, logs, series, metrics, pictures."""

import csv
import json
import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from armgate.apps.errors import UsageError
from armgate.apps.stack.observation import COLUMNS

LONGEST_SOCKET = 107
"""Longest name of a Unix socket on Linux, bytes."""


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


def socket_in(folder: Path) -> Path:
    """Return the name of a socket in the run's folder: relative to here if that is shorter.

    A folder that goes with the run needs no removal, so a run that is killed leaves nothing elsewhere.

    Raises:
        UsageError: The name is longer than the system allows a socket's.
    """
    whole = (folder / "logs" / "robots.sock").absolute()
    name = min((whole, Path(os.path.relpath(whole))), key=lambda path: len(os.fsencode(path)))
    if len(os.fsencode(name)) > LONGEST_SOCKET:
        raise UsageError(
            f"{folder}: too long for the robot server's socket ({len(os.fsencode(name))} bytes; at most "
            f"{LONGEST_SOCKET}); name a shorter folder with --out"
        )
    return name


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
