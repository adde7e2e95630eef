"""Log of a simulated process: its lines become part of the trace."""

from collections.abc import Callable
from typing import Any


class SimulatedLog:
    """`Log` of daemon or robot server, without a thread.

    Args:
        name: Name of the process.
        trace: Adds a line to the trace.
        now: Time of day, s.

    Attributes:
        events: Names of the events so far, with their numbers.
        failures: Failures of the process itself.
    """

    depth = 0

    def __init__(self, name: str, trace: Callable[..., None], now: Callable[[], float]) -> None:
        self._name, self._trace, self._now = name, trace, now
        self._copy: Callable[[dict[str, Any]], None] | None = None
        self.events: dict[str, int] = {}
        self.failures: list[str] = []

    def copy_to(self, receiver: Callable[[dict[str, Any]], None] | None) -> None:
        """Also pass every later event to a receiver."""
        self._copy = receiver

    def info(self, event: str, **fields: Any) -> None:
        """Log a normal event."""
        self._put("info", event, fields)

    def warning(self, event: str, **fields: Any) -> None:
        """Log an event that needs attention."""
        self._put("warning", event, fields)

    def error(self, event: str, **fields: Any) -> None:
        """Log a failure."""
        self._put("error", event, fields)
        if event in ("failed", "not_at_rest"):
            self.failures.append(f"{event}: {fields}")

    def _put(self, level: str, event: str, fields: dict[str, Any]) -> None:
        self.events[event] = self.events.get(event, 0) + 1
        self._trace(self._name, level, event, fields)
        if self._copy is not None:
            self._copy({"time": round(self._now(), 6), "level": level, "event": event, **fields})
