"""Causes of a failed run: a violated rule, the child that ended first, or stops of the daemon."""

import json
import signal
import time
from pathlib import Path
from typing import Any

from armgate.apps.errors import AppError
from armgate.apps.stack.child import INTERRUPTED
from armgate.apps.stack.monitoring import violation_error
from armgate.apps.stack.processes import Children, Exited, Interrupted, Printed
from armgate.cell.terminal_text import printable

_TOGETHER = 1.0
"""Longest time from a cause until all children that fail because of it have ended, s."""
_MOST = 3
"""Largest number of stops that are reported."""


def failure_of(children: Children, event: Exited) -> AppError:
    """Return the error that explains the end of a child, from the events around it.

    If the monitor has reported a violation, that is the cause, because the monitor then stops the robots.
    Otherwise, if a signal ended one of the children, that is the cause of the errors of all others.
    """
    deadline = time.monotonic() + _TOGETHER
    while not _by_signal(event) and (left := deadline - time.monotonic()) > 0.0:
        other = children.next(left)
        if isinstance(other, Interrupted):
            break
        if isinstance(other, Printed) and (error := violation_error(other)) is not None:
            return error
        if isinstance(other, Exited) and _by_signal(other):
            event = other
    return exit_error(children, event)


def _by_signal(event: Exited) -> bool:
    return event.status < 0 or event.status == INTERRUPTED


def exit_error(children: Children, event: Exited) -> AppError:
    """Return the error for a child that ended unexpectedly: which one, how, and the last lines of its log."""
    how = (
        f"was killed by {signal.Signals(-event.status).name}"
        if event.status < 0
        else "was interrupted before its work was done"
        if event.status == INTERRUPTED
        else f"ended ({event.status})"
    )
    tail = "\n".join(f"  | {text}" for text in children.tail(event.name))
    return AppError(f"the {event.name} {how}; its log {children.log(event.name)} ends with\n{tail}")


def stops_in(log: Path) -> str:
    """Return the first stops in a daemon's log, one per line; "" if there are none.

    A participant that lost its robot is not sent the reason of the stop; the daemon's log contains it.
    """
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines() if log.exists() else []
    stops = [event for line in lines if (event := _event(line)).get("event") == "stopped"]
    texts = (
        f"{', '.join(stop['robots'])} stopped by {stop['by']}: {stop['reason']}" for stop in stops[:_MOST]
    )
    return "".join(f"\n  {printable(text)}" for text in texts)


def _event(line: str) -> dict[str, Any]:
    try:
        event = json.loads(line)
    except ValueError:
        return {}
    return event if isinstance(event, dict) else {}
