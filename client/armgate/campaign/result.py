"""Result of one trial."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from armgate.cell.terminal_text import printable

LONGEST = 300
"""Longest reason that is kept, characters."""
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{4,}")


@dataclass(frozen=True)
class Result:
    """Result of a trial; equal for every run of the trial.

    Attributes:
        key: Key of the trial.
        reason: Reason why it failed; "" if it ended as planned.
        figures: Figures by name; empty if it failed.
    """

    key: str
    reason: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """True if the trial failed."""
        return bool(self.reason)


def failed(key: str, error: BaseException) -> Result:
    """Return the result of a trial that raised an error, as one line without addresses of objects."""
    text = printable(" ".join(_text(error).split()))
    return Result(key, _ADDRESS.sub("0x…", text)[:LONGEST])


def _text(error: BaseException) -> str:
    name = type(error).__name__
    try:
        return f"{name}: {error}"
    except Exception:  # a controller's exception may be unable to describe itself
        return name


def worker_ended(key: str, timeout: float) -> Result:
    """Return the result of a trial whose worker ended at every attempt."""
    return Result(key, f"its worker process ended at every attempt, or the timeout of {timeout:g} s passed")
