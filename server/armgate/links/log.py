"""Structured log: one JSON object per line. Writing never delays a tick."""

import json
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, TextIO

_WAITING = 4096


class Log:
    """Log that a thread of its own writes; if the reader is too slow, newer events are dropped and counted.

    The log holds only what callers pass: names, numbers and texts, never a whole message, so that it cannot
    contain a token.

    Args:
        stream: Stream to which lines are written.
        now: Time of day, s since 1970.
    """

    def __init__(self, stream: TextIO, now: Callable[[], float] = time.time) -> None:
        self._stream = stream
        self._now = now
        self._lines: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._dropped = 0
        self._copy: Callable[[dict[str, Any]], None] | None = None
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def copy_to(self, receiver: Callable[[dict[str, Any]], None] | None) -> None:
        """Also pass every later event to a receiver, such as a recorder; None ends this."""
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

    @property
    def depth(self) -> int:
        """Number of lines that wait to be written."""
        return self._lines.qsize()

    def close(self, timeout: float = 1.0) -> None:
        """Write the waiting lines; wait for at most ``timeout`` s."""
        try:
            self._lines.put(None, timeout=timeout)
        except queue.Full:
            return
        self._thread.join(timeout)

    def _put(self, level: str, event: str, fields: dict[str, Any]) -> None:
        record = {"time": round(self._now(), 6), "level": level, "event": event, **fields}
        if self._copy is not None:
            self._copy(dict(record))
        if self._dropped:
            record["dropped_before"] = self._dropped
        try:
            self._lines.put_nowait(json.dumps(record, default=str))
            self._dropped = 0
        except queue.Full:
            self._dropped += 1

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                self._stream.write(line + "\n")
                self._stream.flush()
            except (OSError, ValueError):  # the log has no reader any more: continue without it
                return
