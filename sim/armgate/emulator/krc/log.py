"""The log of a virtual KRC: one JSON object a line."""

import json
import time
from collections.abc import Callable
from typing import TextIO


class Log:
    """Writes notes.

    Args:
        stream: Where the lines go.
        now: Time of day, s since 1970.
    """

    def __init__(self, stream: TextIO, now: Callable[[], float] = time.time) -> None:
        self._stream = stream
        self._now = now

    def __call__(self, level: str, event: str, text: str, **fields: object) -> None:
        """One note."""
        record = {"time": round(self._now(), 6), "level": level, "event": event, "text": text, **fields}
        self._stream.write(json.dumps(record) + "\n")
        self._stream.flush()
