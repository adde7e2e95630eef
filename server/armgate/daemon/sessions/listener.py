"""Accepts connections: a few at a time, a bounded number per second, as many as there is room for.

All this counts before TLS, whose handshake costs more than all that follows. What cannot be accepted yet
waits in the kernel's queue, so that connected clients are not delayed.
"""

import asyncio
import socket
import ssl
from collections.abc import Callable
from pathlib import Path
from time import monotonic

from armgate.daemon.auth.address import origin
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.unix_socket import UnixSocket
from armgate.daemon.sessions import tls_stream
from armgate.daemon.sessions.connection_limits import ConnectionLimits, Slot
from armgate.daemon.sessions.interfaces import ConnectionProtocol
from armgate.daemon.token_bucket import TokenBucket
from armgate.links.log import Log
from armgate.links.robot_server.unix_socket import peer_uid

_QUEUE = 128
"""Connections that may wait in the kernel."""

_AT_ONCE = 4
"""Connections taken in at one turn of the event loop."""

_BURST = 32.0
"""Connections taken in at once after a quiet time."""

_LEAVING = 128
"""Connections that are being told why they may not stay; further ones are closed without a word."""

_RETRY = 1.0
"""How long to wait if the system gives no more connections, s."""


class Listener:
    """Listens at one address.

    Args:
        make: Makes the protocol of a connection. A guest who may not stay is made one too, so that it can be
            told why; ``left`` is to be called when it is gone.
        room: Counts the connections.
        rate: Connections per second on average.
        tls: Encrypts them; None: they are not.
        handshake: How long TLS may take, s.
        log: Where failures are logged.
        refused: Counts the connections that were refused, to bound what is logged.
    """

    def __init__(
        self,
        make: Callable[[Slot], ConnectionProtocol],
        room: ConnectionLimits,
        *,
        rate: float,
        tls: ssl.SSLContext | None,
        handshake: float,
        log: Log,
        refused: FailureLog,
    ) -> None:
        self._refused = refused
        self._make = make
        self._room = room
        self._tls = tls
        self._handshake = handshake
        self._log = log
        self._leaving: set[Slot] = set()
        self._places: dict[Slot, ConnectionProtocol] = {}
        self._handshakes: dict[Slot, asyncio.Task[None]] = {}
        self._sockets: list[socket.socket] = []
        self._timers: dict[socket.socket, asyncio.TimerHandle] = {}
        self._local: UnixSocket | None = None
        self._bucket = TokenBucket(rate, _BURST, monotonic())

    async def open(self, host: str, port: int) -> int:
        """Begin to listen; returns the port.

        Raises:
            OSError: The address cannot be listened on.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        try:
            for family, _, _, _, address in dict.fromkeys(found):
                self._sockets.append(_bound(family, (address[0], port, *address[2:])))
                port = self._sockets[-1].getsockname()[1]  # the same one for all, also where any would do
        except OSError:
            self.close()
            raise
        for sock in self._sockets:
            self._watch(sock)
        return port

    def open_local(self, path: Path) -> None:
        """Begin to listen on a Unix socket too.

        Raises:
            UnixSocketError: It cannot be listened on.
        """
        self._local = UnixSocket(path)
        self._watch(self._local.socket)

    def use_tls(self, tls: ssl.SSLContext) -> dict[str, object]:
        """Encrypt new connections with these certificates; return no fields for the log."""
        self._tls = tls
        return {}

    def close(self) -> None:
        """Accept no more connections; those accepted stay."""
        loop = asyncio.get_running_loop()
        for timer in self._timers.values():
            timer.cancel()
        for task in self._handshakes.values():
            task.cancel()
        for sock in self._sockets:
            loop.remove_reader(sock)
            sock.close()
        self._sockets.clear()
        if self._local is not None:
            loop.remove_reader(self._local.socket)
            self._local.close()
            self._local = None

    def left(self, guest: Slot) -> None:
        """Free the place of a connection that is closed."""
        self._leaving.discard(guest)
        self._places.pop(guest, None)
        self._room.leave(guest)

    # --- taking in ----------------------------------------------------------------------------------------

    def _watch(self, sock: socket.socket) -> None:
        self._timers.pop(sock, None)
        asyncio.get_running_loop().add_reader(sock, self._accept, sock)

    def _rest(self, sock: socket.socket, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(sock)
        self._timers[sock] = loop.call_later(seconds, self._watch, sock)

    def _accept(self, sock: socket.socket) -> None:
        now = monotonic()
        for _ in range(_AT_ONCE):
            if wait := self._bucket.wait(now):
                self._rest(sock, wait)
                return
            try:
                taken, address = sock.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:  # no more files or memory: that may pass
                self._log.error("accept", error=str(error))
                self._rest(sock, _RETRY)
                return
            self._bucket.take(now)
            self._take(taken, address)

    def _take(self, taken: socket.socket, address: tuple[str, int] | str) -> None:
        uid = peer_uid(taken) if taken.family == socket.AF_UNIX else None
        source = origin(address[0]) if uid is None else f"uid {uid}"
        guest, evicted = self._room.enter(source, uid)
        if evicted is not None:
            self._evict(evicted)
        if guest.refusal:
            if len(self._leaving) >= _LEAVING:
                taken.close()
                return
            self._leaving.add(guest)
        taken.setblocking(False)
        task = asyncio.get_running_loop().create_task(self._seat(taken, guest))
        self._handshakes[guest] = task
        task.add_done_callback(lambda done: self._seated(done, taken, guest))

    def _seated(self, done: asyncio.Task[None], taken: socket.socket, guest: Slot) -> None:
        self._handshakes.pop(guest, None)
        if done.cancelled():
            if guest not in self._places:
                taken.close()  # it was cancelled before it began
            self.left(guest)

    def _evict(self, guest: Slot) -> None:
        task = self._handshakes.get(guest)
        if task is not None and not task.done():
            task.cancel()
        elif (place := self._places.get(guest)) is not None:
            self._leaving.add(guest)
            place.evict()

    async def _seat(self, taken: socket.socket, guest: Slot) -> None:
        loop = asyncio.get_running_loop()
        place = self._places[guest] = self._make(guest)
        try:
            if self._tls is None or guest.uid is not None:
                await loop.connect_accepted_socket(lambda: place, taken)
            else:
                await tls_stream.accept(taken, place, self._tls, self._handshake, place.serve)
        except OSError as error:
            self._refused.note(self._log, "tls.failed", guest.origin, monotonic(), error=str(error))
            self.left(guest)


def _bound(family: int, address: tuple[str | int, ...]) -> socket.socket:
    # Without the protocol's name asyncio would not turn Nagle's delays off.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        sock.setblocking(False)
        sock.bind(address)
        sock.listen(_QUEUE)
    except OSError:
        sock.close()
        raise
    return sock
