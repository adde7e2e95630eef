"""Log of a virtual KRC (one JSON object in each line), and trace of its setpoints (CSV)."""

import csv
import json
import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TextIO


class Sink(Protocol):
    """Receiver of log records."""

    def __call__(self, level: str, event: str, text: str, **fields: object) -> None:
        """Record one event: its level, its kind, a plain text, and more fields."""


class JsonLog:
    """Sink that writes records as lines of JSON.

    Args:
        stream: Stream for the lines.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __call__(self, level: str, event: str, text: str, **fields: object) -> None:
        """Write one record."""
        record = {"time": round(time.time(), 6), "level": level, "event": event, "text": text, **fields}
        self._stream.write(json.dumps(record) + "\n")
        self._stream.flush()


class EventLog:
    """Log of events, which limits the records of events that happen in every cycle.

    Args:
        sink: Receiver of the records.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._logged: set[str] = set()

    def info(self, event: str, text: str, **fields: object) -> None:
        """Record a normal event."""
        self._sink("info", event, text, **fields)

    def warning(self, event: str, text: str, **fields: object) -> None:
        """Record an event that needs attention."""
        self._sink("warning", event, text, **fields)

    def repeated(self, event: str, count: int, text: str, **fields: object) -> None:
        """Record the ``count``-th event of its kind as a warning if the count is a power of two."""
        if count & (count - 1) == 0:
            self._sink("warning", event, text, count=count, **fields)

    def once(self, event: str, text: str, **fields: object) -> None:
        """Record a warning unless the same text was recorded before."""
        if text not in self._logged:
            self._logged.add(text)
            self._sink("warning", event, text, **fields)


class SetpointTrace:
    """Trace of the setpoints of the drives, to be compared with bounds later.

    Each cycle is a row: number of the run, number of the cycle, Delay, and the setpoint [deg, mm].

    Args:
        stream: Stream for the rows.
        names: Names of the axes.
    """

    def __init__(self, stream: TextIO, names: Sequence[str]) -> None:
        self._rows = csv.writer(stream)
        self._rows.writerow(("run", "cycle", "delay", *names))

    def write(self, status: Mapping[str, Any]) -> None:
        """Write the row of a cycle from the KRC's status after it."""
        setpoint = (f"{value:.9f}" for value in status["setpoint"].values())
        self._rows.writerow((status["runs"], status["cycles"], status["delay"], *setpoint))
