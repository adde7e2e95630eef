"""Exceptions of the commands; the command line prints their texts.

Tree::

    AppError            the command failed (exit status 1)
    └── UsageError      the command was called incorrectly: a bad file, an unknown robot (exit status 2)
        └── PathError   a path file is malformed; the text names file and line
"""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armgate.client.program import Outcome


class AppError(Exception):
    """Failure of a command; the text gives the reason and the remedy."""

    exit_code = 1


class UsageError(AppError):
    """Incorrect call of a command; no robot was moved."""

    exit_code = 2


class PathError(UsageError):
    """Malformed path file.

    Attributes:
        file: The path file.
        line: Line, counted from 1; None if the error concerns the whole file.
    """

    def __init__(self, file: Path, line: int | None, text: str) -> None:
        self.file = file
        self.line = line
        where = f"{file}:{line}" if line is not None else f"{file}"
        super().__init__(f"{where}: {text}")


def text_of(outcome: "Outcome") -> str:
    """Return the outcome of a program in words.

    Raises:
        AppError: The program failed.
    """
    if outcome.failed:
        raise AppError(outcome.text)
    return outcome.text
