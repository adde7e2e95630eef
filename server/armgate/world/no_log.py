"""Log that keeps nothing."""

from typing import Any


class NoLog:
    """`EventLog` of a world: the messages of its clients and its recordings contain every event."""

    def info(self, event: str, **fields: Any) -> None:
        """Do nothing."""

    def warning(self, event: str, **fields: Any) -> None:
        """Do nothing."""

    def error(self, event: str, **fields: Any) -> None:
        """Do nothing."""
