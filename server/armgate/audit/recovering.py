"""Makes a recording whole whose daemon was killed."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.recording import RecordingError, TruncatedError, parts_of
from armgate.recording.rewrite import rewrite
from armgate.recording.scan import Scan, records, scan


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was done to one file: ``whole`` already, ``recovered``, or ``removed`` as it held nothing.

    Attributes:
        file: The file.
        what: One of these words.
        messages: How many messages it holds now.
        dropped: Bytes at its end that were no whole record.
    """

    file: Path
    what: str
    messages: int = 0
    dropped: int = 0


def recovered(path: Path) -> Sequence[Recovered]:
    """Makes every part of a recording whole.

    Args:
        path: Its folder, or one file.

    Raises:
        RecordingError: There is no recording, it is damaged, nothing of it is left, or there is no room for a
            whole copy; the file stays as it was then.
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
    if found.closed:
        for place in found.chunks:
            records(place)  # raises if one is damaged
        return Recovered(file, "whole")
    if not found.chunks:
        file.unlink()
        return Recovered(file, "removed")
    new = file.with_name(f".{file.name}.recovering")
    try:
        messages, dropped = rewrite(file, new)
        os.replace(new, file)
    except OSError as error:
        text = f"stays as it is: {error.strerror or error}; {found.good} bytes are needed beside it"
        raise RecordingError(file, text) from error
    finally:
        new.unlink(missing_ok=True)
    return Recovered(file, "recovered", messages, dropped)
