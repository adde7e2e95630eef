"""What can be wrong with a recording.

RecordingError
├── ForeignError       no recording of armgate
├── NewerFormatError   written by a later armgate
├── TruncatedError     breaks off: a killed daemon, a full disk, or still written
├── DamagedError       what stands in it is not what was written
└── IncompleteError    a part is missing, or its records have a gap
"""

from pathlib import Path

from pydantic import ValidationError


def first_problem(error: ValidationError) -> str:
    """Return the first finding in one line."""
    found = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(step)[:60] for step in found["loc"])
    return f"{place or 'the whole'}: {found['msg'][:200]}"


class RecordingError(Exception):
    """A recording cannot be used as it was asked for; the text says which, why and what to do.

    Attributes:
        file: The file or folder.
    """

    exit_code = 1

    def __init__(self, file: Path, text: str) -> None:
        super().__init__(f"{file}: {text}")
        self.file = file


class ForeignError(RecordingError):
    """Not a recording of armgate."""

    exit_code = 2


class NewerFormatError(RecordingError):
    """Written by a later armgate."""

    exit_code = 2


class TruncatedError(RecordingError):
    """Breaks off."""


class DamagedError(RecordingError):
    """Changed after it was written."""


class IncompleteError(RecordingError):
    """A part is missing, or the recorder lost records."""
