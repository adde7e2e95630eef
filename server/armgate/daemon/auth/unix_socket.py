"""The daemon's Unix socket: the kernel reports the user of each client, so no token is needed."""

import fcntl
import os
import pwd
import socket
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from armgate.protocol.messages import Role

_QUEUE = 128
"""Number of connections that may wait in the kernel."""

_LOCK = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC


class UnixSocketError(Exception):
    """Unusable socket, or unknown user; the text gives the reason and the remedy."""

    exit_code = 2


def uids(users: Mapping[str, Role]) -> dict[int, Role]:
    """Return roles by user id.

    Args:
        users: Roles by name or number of the user.

    Raises:
        UnixSocketError: This machine has no user of that name.
    """
    return {_uid(user): role for user, role in users.items()}


def _uid(user: str) -> int:
    if user.isascii() and user.isdigit():
        return int(user)
    try:
        return pwd.getpwnam(user).pw_uid
    except KeyError:
        text = f"server.socket.users: this machine has no user {user!r}"
        raise UnixSocketError(f"{text}; expected the name or the number of a user") from None


class UnixSocket:
    """Listening Unix socket; every user may connect, and the daemon grants roles by user.

    Attributes:
        path: Its path.
        socket: The socket.

    Args:
        path: Path to listen on.

    Raises:
        UnixSocketError: Another daemon listens on it, or it cannot be listened on.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _check_folder(path.parent)
        self._lock = _locked(path.with_name(path.name + ".lock"))
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            _unlink(path)
            _bind(self.socket, path)
            self.socket.listen(_QUEUE)
        except OSError as error:
            self.socket.close()
            os.close(self._lock)
            text = f"server.socket.path: cannot listen on {path}: {error.strerror or error}"
            raise UnixSocketError(f"{text}; use another path") from error
        self.socket.setblocking(False)

    def close(self) -> None:
        """Stop listening, and remove the socket."""
        self.socket.close()
        with suppress(OSError):  # another program may have replaced the file
            _unlink(self.path)
        os.close(self._lock)


def _check_folder(folder: Path) -> None:
    """Check that no other user can replace the daemon's socket by another one.

    Raises:
        UnixSocketError: Another user can write the folder, or it does not exist.
    """
    try:
        found = folder.stat()
    except OSError as error:
        raise UnixSocketError(f"server.socket.path: {folder}: {error.strerror}; expected a folder") from error
    writable = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not found.st_mode & stat.S_ISVTX
    if writable or found.st_uid not in (os.geteuid(), 0):
        text = f"server.socket.path: other users may write {folder}, and so replace the socket"
        raise UnixSocketError(f"{text}; expected a folder of this user or of root with mode 755 or less")


def _bind(sock: socket.socket, path: Path) -> None:
    """Bind with mode 666 from the beginning: a chmod afterwards could change another file."""
    before = os.umask(0o111)
    try:
        sock.bind(str(path))
    finally:
        os.umask(before)


def _unlink(path: Path) -> None:
    """Remove a socket that another daemon has left behind, and nothing else."""
    if os.path.lexists(path):
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise FileExistsError(None, "the file exists and is not a socket")
        path.unlink()


def _locked(path: Path) -> int:
    try:
        lock = os.open(path, _LOCK, 0o600)
    except OSError as error:
        raise UnixSocketError(f"server.socket.path: cannot write {path}: {error.strerror}") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(lock)
        text = f"server.socket.path: another daemon listens on {path.with_suffix('')}"
        raise UnixSocketError(f"{text}; end it, or use another path") from error
    return lock
