"""Folder of one run: configuration, logs, series, metrics, pictures."""

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
"""Longest path of a Unix socket on Linux, bytes."""


def make_folder(wanted: Path | None) -> Path:
    """Create the run's folder, ``runs/<local time>`` by default, with a folder for logs.

    Raises:
        UsageError: The folder cannot be created.
    """
    folder = wanted or Path("runs") / datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
    try:
        (folder / "logs").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: cannot be created ({error.strerror}); choose another folder with --out"
        ) from error
    return folder


def socket_in(folder: Path) -> Path:
    """Return the path of a socket in the run's folder, relative to the working directory if that is shorter.

    The socket lies in the run's folder, so a run that is killed leaves nothing elsewhere.

    Raises:
        UsageError: The path is longer than the system allows for a socket.
    """
    whole = (folder / "logs" / "robots.sock").absolute()
    name = min((whole, Path(os.path.relpath(whole))), key=lambda path: len(os.fsencode(path)))
    if len(os.fsencode(name)) > LONGEST_SOCKET:
        raise UsageError(
            f"{folder}: too long for the robot server's socket ({len(os.fsencode(name))} bytes; at most "
            f"{LONGEST_SOCKET}); choose a shorter folder with --out"
        )
    return name


def write_series(folder: Path, rows: list[tuple[float, ...]]) -> None:
    """Write the observed series as ``series.csv``."""
    with (folder / "series.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        table.writerows([f"{value:.9g}" for value in row] for row in rows)


def write_metrics(folder: Path, metrics: Mapping[str, Any]) -> None:
    """Write ``metrics.json``."""
    text = json.dumps(metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
