"""Kernel's side of one connection: socket options, and the kernel's reports about the client.

A client that does not read leaves two traces. First its receive window shrinks, while sent data wait in the
kernel of the client. Then the window is closed, and data wait in this kernel. States are sent only while the
window is open by more than ``_OPEN`` of the widest window seen, so a client that pauses finds few old states.
When the client reads again, its kernel announces the window anew once it has opened by half (RFC 1122,
4.2.3.3). For that reason ``_OPEN`` is below one half.
"""

import asyncio
import socket
import struct
from collections.abc import Callable

_OPEN = 0.4
"""Share of the widest receive window above which a client is assumed to read."""

_UNSENT = 16 * 1024
"""Bytes that the kernel takes before they can be sent; more wait in the `Writer`, which replaces states."""

_KEEPALIVE = ((socket.TCP_KEEPIDLE, 10), (socket.TCP_KEEPINTVL, 5), (socket.TCP_KEEPCNT, 3))
_GIVE_UP = 20.0
"""Time for which data or a probe may stay unacknowledged before the client counts as unreachable, s."""

_ANSWER = 1.0
"""Time after sending within which the acknowledgement of data is expected, s."""

_WATCH = 5.0
"""Time between two checks that the client's kernel still answers, s."""

_HEAD = struct.Struct("=8B24I")
"""Beginning of Linux's ``struct tcp_info``."""

_PROBES, _UNACKED, _LAST_DATA, _LAST_ACK = 3, 8 + 4, 8 + 9, 8 + 12
_WINDOW = struct.Struct("=I")
_WINDOW_AT = 228
"""Offset of ``tcpi_snd_wnd``, which Linux reports since version 5.4."""


class TcpPeerSocket:
    """A TCP connection in the kernel.

    Args:
        sock: Its socket.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self._widest = 0
        self._silent = False
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEPALIVE:
            sock.setsockopt(socket.IPPROTO_TCP, option, value)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT)

    def is_read(self) -> bool:
        """Return True if the client reads, as far as its receive window shows."""
        info = self._sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _WINDOW_AT + _WINDOW.size)
        if len(info) < _WINDOW_AT + _WINDOW.size:
            return True  # an older kernel does not report the window
        (window,) = _WINDOW.unpack_from(info, _WINDOW_AT)
        self._widest = max(self._widest, window)
        return bool(window >= _OPEN * self._widest)

    def is_unreachable(self) -> bool:
        """Return True if this call and the previous one found the client's kernel silent for `_GIVE_UP`.

        Linux's TCP_USER_TIMEOUT would also end a connection whose client answers, but does not read.
        """
        info = _HEAD.unpack_from(self._sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _HEAD.size))
        unanswered = info[_UNACKED] and info[_LAST_ACK] > info[_LAST_DATA] + 1000 * _ANSWER
        silent = bool(info[_PROBES] or unanswered) and info[_LAST_ACK] > 1000 * _GIVE_UP
        before, self._silent = self._silent, silent
        return before and silent


class UnixPeerSocket:
    """A connection over a Unix socket: the kernel buffers little, and reports at once that a client is gone.

    Args:
        sock: Its socket.
    """

    def __init__(self, sock: socket.socket) -> None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * _UNSENT)

    def is_read(self) -> bool:
        """Return True: data that a client does not read soon fill the buffer of the socket."""
        return True

    def is_unreachable(self) -> bool:
        """Return False: the kernel closes a connection whose client is gone."""
        return False


PeerSocket = TcpPeerSocket | UnixPeerSocket


def peer_socket(sock: socket.socket) -> PeerSocket:
    """Return the kernel's side of a connection."""
    return UnixPeerSocket(sock) if sock.family == socket.AF_UNIX else TcpPeerSocket(sock)


class ReachabilityWatch:
    """Regular check that the kernel of a client still answers.

    Args:
        socket: The kernel's side of the connection.
        unreachable: Called once if it does not.
    """

    def __init__(self, socket: PeerSocket, unreachable: Callable[[], None]) -> None:
        self._socket = socket
        self._unreachable = unreachable
        self._timer = self._check_later()

    def cancel(self) -> None:
        """Check no more."""
        self._timer.cancel()

    def _check_later(self) -> asyncio.TimerHandle:
        return asyncio.get_running_loop().call_later(_WATCH, self._check)

    def _check(self) -> None:
        if self._socket.is_unreachable():
            self._unreachable()
        else:
            self._timer = self._check_later()
