"""Exceptions of recordings.

::

    RecordingError
    ├── ForeignError       not a recording of armgate
    ├── NewerFormatError   written by a later version of armgate
    ├── TruncatedError     incomplete: the daemon was killed, the disk was full, or it is still being written
    ├── DamagedError       the content was changed after it was written
    └── IncompleteError    a part is missing, or the recorder lost records
"""

from pathlib import Path

from pydantic import ValidationError


def first_problem(error: ValidationError) -> str:
    """Return the first problem of a validation error on one line."""
    found = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(step)[:60] for step in found["loc"])
    return f"{place or 'whole message'}: {found['msg'][:200]}"


class RecordingError(Exception):
    """Unusable recording; the text states the file, the reason and a remedy.

    Attributes:
        file: File or folder of the recording.
    """

    exit_code = 1

    def __init__(self, file: Path, text: str) -> None:
        super().__init__(f"{file}: {text}")
        self.file = file


class ForeignError(RecordingError):
    """File that is not a recording of armgate."""

    exit_code = 2


class NewerFormatError(RecordingError):
    """Recording written by a later version of armgate."""

    exit_code = 2


class TruncatedError(RecordingError):
    """Incomplete recording: its last bytes are missing."""


class DamagedError(RecordingError):
    """Recording whose content was changed after it was written."""


class IncompleteError(RecordingError):
    """Recording with a missing part or lost records."""
