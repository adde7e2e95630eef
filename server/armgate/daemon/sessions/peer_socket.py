"""The kernel's end of one TCP connection: its options, and what it reports of the client.

A client that does not read leaves two traces. First its receive window shrinks: what was sent waits in the
client's own kernel. Then the window is closed, and data wait in this one. States are sent only while the
window is open by more than ``_OPEN`` of the widest seen, so a client that pauses finds few old states. Once
the client reads, its kernel announces the window anew if it has opened by half (RFC 1122, 4.2.3.3): for that
reason ``_OPEN`` is below one half.
"""

import socket
import struct

_OPEN = 0.4
"""Share of the widest receive window above which a client is taken to read."""

_UNSENT = 16 * 1024
"""Bytes that the kernel takes before they can be sent; more wait in the outbox, where states are replaced."""

_KEEPALIVE = ((socket.TCP_KEEPIDLE, 10), (socket.TCP_KEEPINTVL, 5), (socket.TCP_KEEPCNT, 3))
_GIVE_UP = 20.0
"""How long sent data or a probe may stay unacknowledged before the client is taken to have vanished, s."""

_ANSWER = 1.0
"""How long after data were sent their acknowledgement may come, s."""

_HEAD = struct.Struct("=8B24I")
"""Beginning of Linux's ``struct tcp_info``."""

_PROBES, _UNACKED, _LAST_DATA, _LAST_ACK = 3, 8 + 4, 8 + 9, 8 + 12
_WINDOW = struct.Struct("=I")
_WINDOW_AT = 228
"""Offset of ``tcpi_snd_wnd``, which Linux tells since 5.4."""


class TcpPeerSocket:
    """One connection in the kernel.

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

    def has_room(self) -> bool:
        """Return True if the client reads, as far as its receive window shows."""
        info = self._sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _WINDOW_AT + _WINDOW.size)
        if len(info) < _WINDOW_AT + _WINDOW.size:
            return True  # an older kernel does not tell
        (window,) = _WINDOW.unpack_from(info, _WINDOW_AT)
        self._widest = max(self._widest, window)
        return bool(window >= _OPEN * self._widest)

    def vanished(self) -> bool:
        """Return True if the peer has not answered for `_GIVE_UP`, now and when this was last called.

        Linux's TCP_USER_TIMEOUT would also end a connection whose peer answers, but does not read.
        """
        info = _HEAD.unpack_from(self._sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _HEAD.size))
        unanswered = info[_UNACKED] and info[_LAST_ACK] > info[_LAST_DATA] + 1000 * _ANSWER
        silent = bool(info[_PROBES] or unanswered) and info[_LAST_ACK] > 1000 * _GIVE_UP
        before, self._silent = self._silent, silent
        return before and silent


class UnixPeerSocket:
    """One connection over a Unix socket: the kernel keeps little, and notices at once that a client is gone.

    Args:
        sock: Its socket.
    """

    def __init__(self, sock: socket.socket) -> None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * _UNSENT)

    def has_room(self) -> bool:
        """Return True: what a client does not read soon fills the socket's buffer."""
        return True

    def vanished(self) -> bool:
        """Return False: the kernel closes a connection whose client is gone."""
        return False


def peer_socket(sock: socket.socket) -> TcpPeerSocket | UnixPeerSocket:
    """Return the kernel's end of a connection."""
    return UnixPeerSocket(sock) if sock.family == socket.AF_UNIX else TcpPeerSocket(sock)
