"""What can be wrong with a cell.

CellError
├── ConfigError   a configuration file; knows file, line and key
└── ModelError    a robot description, or a question about a model that it cannot answer
"""

from pathlib import Path


class CellError(Exception):
    """Anything wrong with a cell: its configuration or its models."""


class ConfigError(CellError):
    """A configuration is wrong at a known place.

    The text reads ``file:line: key.path: what is wrong; expected …``; several findings stand on a line each.

    Attributes:
        file: The file of the first finding, None if the configuration did not come from a file.
        line: Its line, counted from 1; None if no line is to blame (a missing file).
        path: The keys that lead to the value, joined by dots; empty for the file as a whole.
    """

    def __init__(self, text: str, file: Path | None = None, line: int | None = None, path: str = "") -> None:
        super().__init__(text)
        self.file = file
        self.line = line
        self.path = path


class ModelError(CellError):
    """A robot description cannot be used, or a model was asked for something that it does not have."""
