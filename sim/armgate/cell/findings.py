"""Errors that are collected, so that one run reports all of them."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from armgate.cell.errors import ConfigError

MAX_FINDINGS = 10


def joined(lines: Iterable[str], most: int | None = MAX_FINDINGS) -> str:
    """Return the first findings, a line each, and how many more there are."""
    every = list(dict.fromkeys(lines))
    if most is None or len(every) <= most:
        return "\n".join(every)
    return "\n".join([*every[:most], f"… and {len(every) - most} more"])


class Findings:
    """Collects errors of a configuration."""

    def __init__(self) -> None:
        self._errors: list[ConfigError] = []

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Take up a ConfigError and go on after the block."""
        try:
            yield
        except ConfigError as error:
            self._errors.append(error)

    def check(self, most: int | None = None) -> None:
        """Raise all errors as one ConfigError; file, line and path are those of the first one.

        Args:
            most: Lines of text; None: all of them, for another collection.
        """
        if self._errors:
            first = self._errors[0]
            lines = [line for error in self._errors for line in str(error).splitlines()]
            raise ConfigError(joined(lines, most), first.file, first.line, first.path)
