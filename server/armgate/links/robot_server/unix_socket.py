"""Unix socket of the robot server: its path, its lock and its permissions."""

import fcntl
import os
import socket
import stat
import struct
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

_CREDENTIALS = struct.Struct("3i")
_LONGEST = 107
"""Longest path of a Unix socket on Linux, bytes."""
_LOCK = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


class SocketError(Exception):
    """Unusable socket; the text names the reason and the remedy."""

    exit_code = 2


def default_path(cell: str) -> Path:
    """Return the default path of a cell's robot server."""
    return _own_folder() / f"{cell}.sock"


def _own_folder() -> Path:
    """Return this user's folder for sockets, into which other users cannot put links or files."""
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"armgate-{os.getuid()}"


def listen(path: Path) -> tuple[socket.socket, IO[str]]:
    """Listen on a path, for this user only.

    Returns:
        The socket, and the file whose lock marks it as used.

    Raises:
        SocketError: Another robot server uses the path, or it is not possible to listen on it.
    """
    _check_length(path)
    if path.parent == _own_folder():
        _make_private(path.parent)
    lock = _lock_file(path.with_name(path.name + ".lock"))
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        with suppress(FileNotFoundError):
            path.unlink()  # left by a robot server that was killed: this process has the lock
        sock.bind(str(path))
        sock.listen(4)
    except OSError as error:
        sock.close()
        lock.close()
        raise SocketError(f"cannot listen on {path}: {error.strerror}; name another --socket") from error
    finally:
        os.umask(before)
    sock.setblocking(False)
    return sock, lock


def connect(path: Path) -> socket.socket:
    """Connect to the robot server.

    Raises:
        SocketError: No robot server listens on the path, or it belongs to another user.
    """
    _check_length(path)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        sock.connect(str(path))
    except OSError as error:
        sock.close()
        raise SocketError(
            f"no robot server at {path} ({error.strerror}): start it first, with the same configuration: "
            f"armgate robot-server CONFIG… --socket {path}"
        ) from error
    if (uid := peer_uid(sock)) not in (os.getuid(), 0):
        sock.close()
        raise SocketError(f"the robot server at {path} belongs to user {uid}; expected your own")
    sock.setblocking(False)
    return sock


def peer_uid(sock: socket.socket) -> int:
    """Return the user id of the peer, as the kernel reports it."""
    given = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, uid, _ = _CREDENTIALS.unpack(given)
    return int(uid)


def _make_private(folder: Path) -> None:
    """Make the folder, or check that it is private: any user may have made it before.

    Raises:
        SocketError: It cannot be made, or belongs to another user, or others may use it.
    """
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise SocketError(f"cannot make {folder}: {error.strerror}; name another --socket") from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        text = "expected a folder of this user with mode 0700"
        raise SocketError(f"{folder}: {text}; remove it, or name another --socket")


def _lock_file(path: Path) -> IO[str]:
    try:
        lock = os.fdopen(os.open(path, _LOCK, 0o600), "a")
    except OSError as error:
        why = "is a symbolic link" if path.is_symlink() else error.strerror
        raise SocketError(f"cannot write {path}: {why}; remove it, or name another --socket") from error
    found = os.fstat(lock.fileno())
    if not stat.S_ISREG(found.st_mode) or found.st_uid != os.getuid():
        lock.close()
        raise SocketError(f"{path}: expected a file of this user; remove it, or name another --socket")
    os.fchmod(lock.fileno(), 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        lock.close()
        name = path.name.removesuffix(".lock")
        raise SocketError(
            f"another robot server listens on {path.with_name(name)}; end it, or name another --socket"
        ) from error
    return lock


def _check_length(path: Path) -> None:
    if len(os.fsencode(path)) > _LONGEST:
        raise SocketError(f"{path}: longer than {_LONGEST} bytes, a socket's limit; name a shorter path")
