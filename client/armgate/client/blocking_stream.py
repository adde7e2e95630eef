"""Socket of the blocking shell, plain or with TLS. The socket itself never blocks."""

import select
import socket
import ssl
from errno import ETIMEDOUT
from time import monotonic, sleep
from typing import Any

from armgate.client.address import parse_address, socket_path
from armgate.client.security import check_no_tls

_CHUNK = 64 * 1024
"""Size of one read: for larger reads the allocator requests new memory from the system each time."""

RETRY = 0.02
"""Time between two attempts to connect while the queue of a Unix socket is full, s."""


class Stream:
    """Connected socket.

    Args:
        sock: The socket; the stream takes ownership.

    Attributes:
        emptied: True if the last ``receive`` returned all bytes that had arrived.
    """

    def __init__(self, sock: socket.socket) -> None:
        if sock.family != socket.AF_UNIX:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        self._socket = sock
        self.emptied = False
        self._tls = sock if isinstance(sock, ssl.SSLSocket) else None
        self._readable = _poller(sock, select.POLLIN)
        self._writable = _poller(sock, select.POLLIN | select.POLLOUT)

    @classmethod
    def open(cls, address: str, timeout: float, tls: ssl.SSLContext | None) -> "Stream":
        """Connect to ``HOST:PORT`` or ``unix:PATH``; TCP and TLS each within ``timeout``.

        Raises:
            BadArgument: The address is invalid, or TLS is requested on a Unix socket.
            OSError: No daemon listens there, or TLS fails.
        """
        path = socket_path(address)
        if path is None:
            return cls(_tcp(*parse_address(address), timeout, tls))
        check_no_tls(address, tls)
        return cls(_unix(path, timeout))

    @property
    def peer(self) -> Any:
        """Address of the peer."""
        return self._socket.getpeername()

    def receive(self) -> bytes | None:
        """Return the bytes that have arrived; empty at the end of the stream, None if there are none yet.

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
        """Send as many bytes as the socket accepts; return their number.

        Raises:
            OSError: The connection broke.
        """
        try:
            return self._socket.send(data)
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            return 0

    def wait(self, timeout: float, *, writing: bool) -> bool:
        """Wait until bytes have arrived or (``writing``) can be sent; return False after ``timeout``."""
        if self._tls is not None and self._tls.pending():
            return True
        poller = self._writable if writing else self._readable
        wait = None if timeout == float("inf") else max(0.0, timeout) * 1000
        return bool(poller.poll(wait))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _poller(sock: socket.socket, events: int) -> "select.poll":
    poller = select.poll()
    poller.register(sock, events)
    return poller


def _tcp(host: str, port: int, timeout: float, tls: ssl.SSLContext | None) -> socket.socket:
    sock = socket.create_connection((host, port), timeout)
    if tls is None:
        return sock
    try:
        return tls.wrap_socket(sock, server_hostname=host)
    except BaseException:
        sock.close()
        raise


def _unix(path: str, timeout: float) -> socket.socket:
    """Connect to a Unix socket; retry while its queue is full, which the kernel reports at once."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    end = monotonic() + timeout
    try:
        sock.settimeout(timeout)
        while True:
            try:
                sock.connect(path)
            except BlockingIOError:
                if monotonic() + RETRY > end:
                    raise TimeoutError(ETIMEDOUT, f"the queue of {path} is full") from None
                sleep(RETRY)
            else:
                return sock
    except BaseException:
        sock.close()
        raise
