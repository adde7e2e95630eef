"""The robot server's socket: where it is, who may use it."""

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
"""Bytes that Linux takes as the name of such a socket."""
_LOCK = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


class SocketError(Exception):
    """The socket cannot be used; the text says why, and what to do."""

    exit_code = 2


def default_path(cell: str) -> Path:
    """Return the path at which a cell's robot server listens by default."""
    return _own_folder() / f"{cell}.sock"


def _own_folder() -> Path:
    """Return this user's folder for sockets: others cannot put links or files into it."""
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"armgate-{os.getuid()}"


def listen(path: Path) -> tuple[socket.socket, IO[str]]:
    """Listen there, for this user alone.

    Returns:
        The socket, and a file whose lock tells that it is in use.

    Raises:
        SocketError: Another robot server listens there, or it cannot be listened on.
    """
    _check_length(path)
    if path.parent == _own_folder():
        _make_own(path.parent)
    lock = _locked(path.with_name(path.name + ".lock"))
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        with suppress(FileNotFoundError):
            path.unlink()  # left by one that was killed: the lock is ours
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


def call(path: Path) -> socket.socket:
    """Connect to the robot server.

    Raises:
        SocketError: Nobody listens there, or another user does.
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
    """The user at the other end, as the kernel tells."""
    given = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, uid, _ = _CREDENTIALS.unpack(given)
    return int(uid)


def _make_own(folder: Path) -> None:
    """Make the folder, or check that it is ours alone: anybody may have made it before.

    Raises:
        SocketError: It is not.
    """
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise SocketError(f"cannot make {folder}: {error.strerror}; name another --socket") from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        text = "expected a folder of this user with mode 0700"
        raise SocketError(f"{folder}: {text}; remove it, or name another --socket")


def _locked(path: Path) -> IO[str]:
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
        raise SocketError(f"{path}: longer than the {_LONGEST} bytes of a socket's name; name a shorter one")
