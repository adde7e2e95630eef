"""Errors of a cell, and the collector that reports all errors of a configuration together.

CellError
├── ConfigError   error in a configuration file, with file, line and key
└── ModelError    unusable robot description, or a query that a model cannot answer
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

MAX_LINES = 10
"""Largest number of errors that one message lists."""


class CellError(Exception):
    """Error in the configuration or in a model of a cell."""


class ConfigError(CellError):
    """Error at a known place of a configuration.

    The text reads ``file:line: key.path: what is wrong; expected …``. Several errors take a line each.

    Attributes:
        file: File of the first error, None if the configuration did not come from a file.
        line: Line of the first error, counted from 1; None if no line is involved (a missing file).
        path: Keys that lead to the value, joined by dots; empty for the file as a whole.
    """

    def __init__(self, text: str, file: Path | None = None, line: int | None = None, path: str = "") -> None:
        super().__init__(text)
        self.file = file
        self.line = line
        self.path = path


class ModelError(CellError):
    """Unusable robot description, or a query for something that the model does not have."""


def join_lines(lines: Iterable[str], most: int | None = MAX_LINES) -> str:
    """Return the first ``most`` different lines and the number of lines left out; None: all lines."""
    distinct = list(dict.fromkeys(lines))
    if most is None or len(distinct) <= most:
        return "\n".join(distinct)
    return "\n".join([*distinct[:most], f"… and {len(distinct) - most} more"])


class ErrorCollector:
    """Collector of ``ConfigError``s, so that one run reports all of them."""

    def __init__(self) -> None:
        self._errors: list[ConfigError] = []

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Catch and keep a ConfigError that the block raises."""
        try:
            yield
        except ConfigError as error:
            self._errors.append(error)

    def check(self, most: int | None = None) -> None:
        """Raise all collected errors as one ConfigError; file, line and path are those of the first.

        Args:
            most: Largest number of lines of the text; None: all of them, for another collector.
        """
        if self._errors:
            first = self._errors[0]
            lines = [line for error in self._errors for line in str(error).splitlines()]
            raise ConfigError(join_lines(lines, most), first.file, first.line, first.path)


def install_hint(extra: str) -> str:
    """Return the command that installs an extra; no package index has armgate, so it needs a checkout."""
    return f"in a checkout of armgate: pip install '.[{extra}]'"
