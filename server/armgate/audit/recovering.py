"""Makes a recording whole whose daemon was killed, or which is damaged."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from armgate.recording import RecordingError, TruncatedError, parts_of
from armgate.recording.files import atomic_write
from armgate.recording.recover import Recovery, is_readable, recover_file
from armgate.recording.scan import Scan, scan

_NOTHING = Recovery(0, 0, 0)
_COPIES = 100


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result for one file.

    Attributes:
        file: The file.
        what: ``whole`` already, ``recovered``, or ``removed`` because it held nothing.
        result: Contents of the recovered file.
        original: Copy of the damaged file, if messages before its end are lost.
    """

    file: Path
    what: str
    result: Recovery = _NOTHING
    original: Path | None = None


def recovered(path: Path) -> Sequence[Recovered]:
    """Make every part of a recording whole.

    Args:
        path: Its folder, or one file.

    Raises:
        RecordingError: There is no recording, the beginning of a file is damaged, or there is no room for
            a whole copy; the file stays as it was then.
    """
    files = parts_of(path)
    scans = [scan(file) for file in files]
    if not any(found.chunks for found in scans):
        raise TruncatedError(files[0], "breaks off before anything was written; nothing can be recovered")
    for found in scans[:-1]:
        if not found.chunks:
            raise RecordingError(found.file, "is empty, but later parts are not; restore it from a copy")
    return [_recovered(found) for found in scans]


def _recovered(found: Scan) -> Recovered:
    file = found.file
    if found.closed and is_readable(found.chunks):
        return Recovered(file, "whole")
    if not found.chunks:
        file.unlink()
        return Recovered(file, "removed")
    try:
        with atomic_write(file) as stream:
            result = recover_file(file, stream)
            original = _kept(file) if result.lost else None
    except OSError as error:
        text = f"stays as it is: {error.strerror or error}; {found.good} bytes are needed beside it"
        raise RecordingError(file, text) from error
    return Recovered(file, "recovered", result, original)


def _kept(file: Path) -> Path:
    """Give the damaged file a second name: what could not be read is in it only.

    Raises:
        OSError: It cannot get one.
    """
    for suffix in ("", *(f"-{number}" for number in range(2, _COPIES + 1))):
        original = file.with_name(f"{file.name}.damaged{suffix}")
        with suppress(FileExistsError):
            os.link(file, original, follow_symlinks=False)
            return original
    raise FileExistsError(f"{_COPIES} damaged copies of it are kept already; remove some")
