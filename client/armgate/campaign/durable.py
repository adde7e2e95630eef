"""Files that are complete or absent after a crash: temporary name, fsync, rename, fsync of the folder."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

TEMPORARY = ".tmp"
"""End of the names of files that are not complete."""


def write_durably(path: Path, data: bytes, write: Callable[[int, bytes], int] = os.write) -> None:
    """Write a file so that it is on the disk, complete, when this function returns.

    Args:
        path: The file; an existing one is replaced as a whole.
        data: Its content.
        write: Writes bytes to a descriptor and returns their number.

    Raises:
        OSError: It cannot be written; ``path`` is unchanged.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        _write_all(temporary, data, write)
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _write_all(path: Path, data: bytes, write: Callable[[int, bytes], int]) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    try:
        left = memoryview(data)
        while left:
            left = left[write(descriptor, bytes(left)) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _sync_folder(folder: Path) -> None:
    """Write the names in a folder to the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
