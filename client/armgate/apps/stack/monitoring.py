"""Monitor of a run: ``armgate monitor``, live by the wall clock, or an audit of the recording in lock-step.

In lock-step, the clock waits only for participants: an observer could miss states, and its stop would arrive
at a different step each time. The recording holds every state.
"""

import json
import re
import signal
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from armgate.apps.errors import AppError
from armgate.apps.stack.processes import Children, Interrupted, Printed

MONITOR = "monitor"
WATCHING = re.compile(r"^armgate: monitor: (watching .+)$")
VIOLATED = re.compile(r"^armgate: monitor: (violated: .+)$")
AUDIT_TIME = 600.0
"""Timeout of the audit of a recording, s."""
_KILLED = 5.0
"""Timeout for the end of a killed child, s."""


def monitor_command(address: str, configs: Sequence[Path], folder: Path | None) -> list[str]:
    """Return the arguments of ``armgate`` that start the live monitor."""
    return ["monitor", address, *map(str, configs), *_written(folder)]


def _written(folder: Path | None) -> list[str]:
    return [] if folder is None else ["--json", str(_file(folder))]


def _file(folder: Path) -> Path:
    return folder / "monitor.json"


def remove_report(folder: Path) -> None:
    """Remove the monitor's report of an earlier run from this folder."""
    _file(folder).unlink(missing_ok=True)


def violation_error(event: Printed) -> AppError | None:
    """Return the error for a line in which the monitor reports a violation; None for any other line."""
    match = VIOLATED.match(event.text) if event.name == MONITOR else None
    return None if match is None else AppError(f"the monitor reports a violated rule: {match[1]}")


def audit(children: Children, folder: Path) -> tuple[bool, AppError | None]:
    """Audit the recording of a run that has ended.

    Returns:
        True if the audit was not interrupted, and its error, if any.
    """
    children.launch(MONITOR, ["monitor", str(folder), *_written(folder)], priority=0)
    found: AppError | None = None
    deadline = time.monotonic() + AUDIT_TIME
    while (event := children.next(max(0.0, deadline - time.monotonic()))) is not None:
        if isinstance(event, Interrupted):
            children.send(signal.SIGKILL, MONITOR)
            children.wait([MONITOR], _KILLED)
            remove_report(folder)  # it may be incomplete
            return False, found
        if isinstance(event, Printed):
            found = found or violation_error(event)
        elif event.name == MONITOR:
            failed = AppError(f"the monitor ended ({event.status}): {' '.join(children.tail(MONITOR)[-1:])}")
            return True, found or (failed if event.status else None)
    return True, AppError(f"the audit took longer than {AUDIT_TIME:g} s; see {children.log(MONITOR)}")


def read_report(folder: Path | None) -> Mapping[str, Any] | None:
    """Return the monitor's report of a run; None if there is none."""
    if folder is None or not _file(folder).is_file():
        return None
    found: Mapping[str, Any] = json.loads(_file(folder).read_text(encoding="utf-8"))
    return found
