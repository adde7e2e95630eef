"""Recovery of a recording that is incomplete because the daemon was killed, or that is damaged."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from armgate.recording import DamagedError, RecordingError, TruncatedError, parts_of
from armgate.recording.files import atomic_write
from armgate.recording.recover import Recovery, is_readable, recover_file
from armgate.recording.scan import Scan, scan

Action = Literal["none", "removed", "recovered"]
"""Action on a file: ``none`` if it is complete, ``removed`` if it holds no message, or ``recovered``."""

_NOTHING = Recovery(0, 0, 0)
_COPIES = 100


@dataclass(frozen=True, slots=True)
class RecoveredFile:
    """Result for one file.

    Attributes:
        file: The file.
        action: Action on the file.
        result: Contents of the recovered file.
        original: Copy of the damaged file, if messages before its end are lost or none can be read.
    """

    file: Path
    action: Action
    result: Recovery = _NOTHING
    original: Path | None = None


def recover_recording(path: Path) -> Sequence[RecoveredFile]:
    """Recover every part of a recording.

    Args:
        path: Its folder, or one file.

    Raises:
        RecordingError: There is no recording, the beginning of a file is damaged, no message can be read, or
            there is no space for a complete copy; the file is then unchanged.
    """
    files = parts_of(path)
    scans = [scan(file) for file in files]
    if not any(found.chunks for found in scans):
        raise TruncatedError(files[0], "is truncated before its first message; nothing can be recovered")
    for found in scans[:-1]:
        if not found.chunks:
            raise RecordingError(found.file, "is empty, but later parts are not; restore it from a copy")
    alone = scans[0] is scans[-1]
    return [_recover_part(found, removable=found is scans[-1] and not alone) for found in scans]


def _recover_part(found: Scan, *, removable: bool) -> RecoveredFile:
    """Recover one file; remove it, but keep a copy, if it is ``removable`` and no message can be read."""
    file = found.file
    if found.closed and is_readable(found.chunks):
        return RecoveredFile(file, "none")
    if not found.chunks:
        file.unlink()
        return RecoveredFile(file, "removed")
    try:
        with atomic_write(file) as stream:
            result = recover_file(file, stream)
            if not (result.messages or removable):
                raise DamagedError(file, "holds no message that can be read; nothing can be recovered")
            original = _keep_original(file) if result.lost or not result.messages else None
    except OSError as error:
        text = f"was not changed: {error.strerror or error}; {found.good} bytes are needed for a copy"
        raise RecordingError(file, text) from error
    if not result.messages:
        file.unlink()
    return RecoveredFile(file, "recovered" if result.messages else "removed", result, original)


def _keep_original(file: Path) -> Path:
    """Link the damaged file under a second name, because only this file contains the unreadable messages.

    Raises:
        OSError: The link cannot be created.
    """
    for suffix in ("", *(f"-{number}" for number in range(2, _COPIES + 1))):
        original = file.with_name(f"{file.name}.damaged{suffix}")
        with suppress(FileExistsError):
            os.link(file, original, follow_symlinks=False)
            return original
    raise FileExistsError(f"{_COPIES} copies of damaged files exist already; remove some")
