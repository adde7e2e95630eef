"""What a virtual KRC tells whoever reads its log."""

from typing import Protocol


class Sink(Protocol):
    """Takes notes."""

    def __call__(self, level: str, event: str, text: str, **fields: object) -> None:
        """One note: how grave, what kind, and the same in plain words."""


class Notes:
    """Notes on their way to the log, such that what happens in every cycle does not flood it.

    Args:
        sink: The log.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._said: set[str] = set()

    def info(self, event: str, text: str, **fields: object) -> None:
        """Something happened as it should."""
        self._sink("info", event, text, **fields)

    def warning(self, event: str, text: str, **fields: object) -> None:
        """Something that somebody should look at."""
        self._sink("warning", event, text, **fields)

    def often(self, event: str, count: int, text: str, **fields: object) -> None:
        """The ``count``-th of its kind: told when the count is a power of two."""
        if count & (count - 1) == 0:
            self._sink("warning", event, text, count=count, **fields)

    def once(self, event: str, text: str, **fields: object) -> None:
        """The same text is told only once."""
        if text not in self._said:
            self._said.add(text)
            self._sink("warning", event, text, **fields)
