"""Bounded reading of regular files that a user names."""

import os
import stat
from pathlib import Path

from armgate.cell.errors import ModelError


def read_file(path: Path, most: int) -> bytes:
    """Return the content of a regular file.

    Devices and pipes are refused, because reading them may never end.

    Args:
        path: The file.
        most: Largest size, bytes.

    Raises:
        ModelError: The file cannot be read, is not a regular file, or is larger; the text does not name it.
    """
    try:
        with open(path, "rb", opener=_open_nonblocking) as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise ModelError("cannot be read: it is a device or pipe; expected a regular file")
            data = stream.read(most + 1)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ModelError(f"cannot be read: {reason}; check the path and its permissions") from error
    except ValueError as error:  # NUL, or a character that UTF-8 cannot encode
        raise ModelError("cannot be read: no file can have this name; check the path") from error
    if len(data) > most:
        raise ModelError(f"more than {most} bytes; expected a smaller file")
    return data


def _open_nonblocking(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def is_file(path: Path) -> bool:
    """Return True for a regular file, and False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
