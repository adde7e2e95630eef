"""The robot server's socket: where it is, who may use it."""

import fcntl
import os
import socket
import struct
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

_CREDENTIALS = struct.Struct("3i")
_LONGEST = 107
"""Bytes that Linux takes as the name of such a socket."""


class SocketError(Exception):
    """The socket cannot be used; the text says why, and what to do."""

    exit_code = 2


def default_path(cell: str) -> Path:
    """Where a cell's robot server listens unless told otherwise."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(folder) / f"armgate-{os.getuid()}-{cell}.sock"


def listen(path: Path) -> tuple[socket.socket, IO[str]]:
    """Listen there, for this user alone.

    Returns:
        The socket, and a file whose lock tells that it is in use.

    Raises:
        SocketError: Another robot server listens there, or it cannot be listened on.
    """
    _check_length(path)
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


def _locked(path: Path) -> IO[str]:
    try:
        lock = path.open("a")
        path.chmod(0o600)
    except OSError as error:
        raise SocketError(f"cannot write {path}: {error.strerror}; name another --socket") from error
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
