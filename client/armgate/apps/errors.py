"""What the programs raise; the command line prints it as one line.

Tree::

    AppError            the command failed (exit status 1)
    └── UsageError      the command was called wrongly: a bad file, an unknown robot (exit status 2)
        └── PathError   a path file is not what it should be; names file and line
"""

from pathlib import Path


class AppError(Exception):
    """The command could not do what it was asked to; the text says why and what to do."""

    exit_code = 1


class UsageError(AppError):
    """What the command was given is wrong: nothing was moved."""

    exit_code = 2


class PathError(UsageError):
    """A path file is malformed.

    Attributes:
        file: The file.
        line: The line, counted from 1; None where the whole file is meant.
    """

    def __init__(self, file: Path, line: int | None, text: str) -> None:
        self.file = file
        self.line = line
        where = f"{file}:{line}" if line is not None else f"{file}"
        super().__init__(f"{where}: {text}")
