"""Result of one trial."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

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


def failed(key: str, error: Exception) -> Result:
    """Return the result of a trial that raised an error, as one line without addresses of objects."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return Result(key, _ADDRESS.sub("0x…", text)[:LONGEST])


def worker_ended(key: str, timeout: float) -> Result:
    """Return the result of a trial whose worker ended at every attempt."""
    return Result(key, f"its worker process ended at every attempt, or the timeout of {timeout:g} s passed")
