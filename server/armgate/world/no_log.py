"""Log that keeps nothing."""

from typing import Any


class NoLog:
    """`EventLog` of a world: all that happens is in the messages of its clients and in its recordings."""

    def info(self, event: str, **fields: Any) -> None:
        """Do nothing."""

    def warning(self, event: str, **fields: Any) -> None:
        """Do nothing."""

    def error(self, event: str, **fields: Any) -> None:
        """Do nothing."""
