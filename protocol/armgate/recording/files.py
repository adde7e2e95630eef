"""Safe access to the files of a recording from an untrusted source, and to files that commands write.

Symbolic links in the folder of a run are never followed, devices and pipes are never read, and files are
never overwritten in place.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkstemp
from typing import BinaryIO

from armgate.recording.errors import ForeignError

_READ = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        ForeignError: The path is a symbolic link, a device, a pipe or a folder.
        OSError: The file cannot be read.
    """
    try:
        descriptor = os.open(path, _READ)
    except OSError as error:
        if path.is_symlink():
            raise ForeignError(path, "a symbolic link; expected the file itself") from error
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise ForeignError(path, "neither a file nor a folder; expected a recording")
    return os.fdopen(descriptor, "rb")


def output_problem(path: Path) -> str | None:
    """Return why a command cannot write a file to this place, with the remedy; None if it may be possible."""
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}; create it, or choose another file"
    if path.is_dir():
        return "is a folder; expected the name of a file"
    return None


@contextmanager
def atomic_write(path: Path) -> Iterator[BinaryIO]:
    """Write a temporary file in the same folder and move it to ``path`` when it is complete.

    A symbolic link at ``path`` is replaced, not followed.

    Raises:
        OSError: The file cannot be written; an existing file at ``path`` stays unchanged.
    """
    descriptor, name = mkstemp(prefix=f".{path.name[:100]}.", dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            yield stream
            stream.flush()
            os.fchmod(stream.fileno(), 0o644)
            os.fsync(stream.fileno())
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
