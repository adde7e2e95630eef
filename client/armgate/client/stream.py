"""The blocking shell's bytes: a socket that never blocks by itself, plain or with TLS."""

import select
import socket
import ssl
from errno import ETIMEDOUT
from time import monotonic, sleep
from typing import Any

_CHUNK = 64 * 1024
"""Room for what comes at once: more than this is memory that the system makes anew each time."""

AGAIN = 0.02
"""Time between two attempts to connect while the queue of a Unix socket is full, s."""


class Stream:
    """A connected socket.

    Args:
        sock: The socket; this takes it over.

    Attributes:
        emptied: Whether nothing more had come when something was received last.
    """

    def __init__(self, sock: socket.socket) -> None:
        if sock.family != socket.AF_UNIX:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        self._socket = sock
        self.emptied = False
        self._tls = sock if isinstance(sock, ssl.SSLSocket) else None

    @classmethod
    def open(cls, host: str, port: int, timeout: float, tls: ssl.SSLContext | None) -> "Stream":
        """Connects, within ``timeout`` for TCP and again for TLS.

        Raises:
            OSError: Nobody listens there, or TLS fails.
        """
        sock = socket.create_connection((host, port), timeout)
        if tls is None:
            return cls(sock)
        try:
            return cls(tls.wrap_socket(sock, server_hostname=host))
        except BaseException:
            sock.close()
            raise

    @classmethod
    def open_local(cls, path: str, timeout: float) -> "Stream":
        """Connect to a Unix socket within ``timeout``.

        Raises:
            OSError: No daemon listens there, or its queue is full until the end of ``timeout``.
        """
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            sock.settimeout(timeout)
            _connect(sock, path, monotonic() + timeout)
        except BaseException:
            sock.close()
            raise
        return cls(sock)

    @property
    def peer(self) -> Any:
        """The address of the other end."""
        return self._socket.getpeername()

    def receive(self) -> bytes | None:
        """What has come; empty at the end, None for nothing yet.

        Raises:
            OSError: The connection broke.
        """
        try:
            data = self._socket.recv(_CHUNK)
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            return None
        self.emptied = self._tls is None and 0 < len(data) < _CHUNK
        return data

    def send(self, data: memoryview) -> int:
        """Sends what fits; how much that was.

        Raises:
            OSError: The connection broke.
        """
        try:
            return self._socket.send(data)
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            return 0

    def wait(self, timeout: float, *, writing: bool) -> bool:
        """Waits until something has come, or (``writing``) can be sent; whether it was so in time."""
        if self._tls is not None and self._tls.pending():
            return True
        poller = select.poll()
        poller.register(self._socket, select.POLLIN | (select.POLLOUT if writing else 0))
        wait = None if timeout == float("inf") else max(0.0, timeout) * 1000
        return bool(poller.poll(wait))

    def close(self) -> None:
        """Closes it."""
        self._socket.close()


def _connect(sock: socket.socket, path: str, end: float) -> None:
    """Connect to a Unix socket; while its queue is full, which the kernel reports at once, try again."""
    while True:
        try:
            sock.connect(path)
        except BlockingIOError:
            if monotonic() + AGAIN > end:
                raise TimeoutError(ETIMEDOUT, f"the queue of {path} is full") from None
            sleep(AGAIN)
        else:
            return
