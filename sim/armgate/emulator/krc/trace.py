"""What the drives were given, cycle by cycle, as CSV: to be held against bounds afterwards."""

import csv
from collections.abc import Mapping, Sequence
from typing import Any, TextIO


class Trace:
    """Writes a row for each cycle of a run: its number, the run's, the Delay, and the setpoint (deg, mm).

    Args:
        stream: Where the rows go.
        names: The axes.
    """

    def __init__(self, stream: TextIO, names: Sequence[str]) -> None:
        self._rows = csv.writer(stream)
        self._rows.writerow(("run", "cycle", "delay", *names))

    def take(self, status: Mapping[str, Any]) -> None:
        """A cycle has passed; the KRC's status after it."""
        setpoint = (f"{value:.9f}" for value in status["setpoint"].values())
        self._rows.writerow((status["runs"], status["cycles"], status["delay"], *setpoint))
