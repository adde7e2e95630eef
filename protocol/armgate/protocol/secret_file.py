"""Files with secrets: other users must be able neither to read nor to replace them.

The rules are those of ssh. A file of this user must not be accessible to any other user. A file of root may
be readable by a group, which administrators use to share keys with services, but not by all users. A file of
another user is not trusted: that user could replace it.
"""

import os
import stat
from pathlib import Path

MAX_CHARACTERS = 1 << 20
"""Longest accepted file of tokens; reading a device may never end."""

_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_ALL = stat.S_IRWXO | stat.S_IWGRP


class SecretFileError(Exception):
    """Wrong owner or permissions of a file with a secret; the text names the file and a remedy."""

    exit_code = 2


def check_secret_file(file: Path) -> None:
    """Check owner and permissions of a file by the rules above.

    Raises:
        OSError: There is no such file.
        SecretFileError: Other users can read the file, or it belongs to another user.
    """
    _check(file, file.stat())


def read_secret_file(file: Path) -> str:
    """Return the text of a file whose owner and permissions follow the rules above.

    Raises:
        OSError: The file cannot be read.
        UnicodeDecodeError: The file is not UTF-8.
        SecretFileError: Other users can read the file, it belongs to another user, or it is too large.
    """
    with file.open(encoding="utf-8") as opened:
        _check(file, os.fstat(opened.fileno()))
        text = opened.read(MAX_CHARACTERS + 1)
    if len(text) > MAX_CHARACTERS:
        raise SecretFileError(f"{file}: more than {MAX_CHARACTERS} characters; expected a file of tokens")
    return text


def _check(file: Path, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        return  # a pipe or a terminal, such as /dev/stdin
    if found.st_uid not in (os.geteuid(), 0):
        text = f"{file}: belongs to user {found.st_uid}, who could replace it"
        raise SecretFileError(f"{text}; expected your own file: copy it, and run: chmod 600")
    own = found.st_uid == os.geteuid()
    if found.st_mode & (_OTHERS if own else _ALL):
        text = f"{file}: other users of this machine can read this secret"
        raise SecretFileError(f"{text} (mode {stat.S_IMODE(found.st_mode):04o}); run: chmod 600 {file}")
