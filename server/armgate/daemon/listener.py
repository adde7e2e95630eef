"""Takes connections in: a few at a time, so many per second, so many at once in all and from one address.

All this counts before TLS, whose handshake costs more than all that follows. What cannot be taken in yet
waits in the kernel's queue: those who are in already do not pay for it.
"""

import asyncio
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from armgate.daemon.address import origin
from armgate.daemon.bucket import Bucket
from armgate.daemon.log import Log

_QUEUE = 128
"""Connections that may wait in the kernel."""

_AT_ONCE = 4
"""Connections taken in at one turn of the event loop."""

_BURST = 32.0
"""Connections taken in at once after a quiet time."""

_RETRY = 1.0
"""How long to wait where the system gives no more connections, s."""


@dataclass(frozen=True, slots=True)
class Guest:
    """Where a connection comes from, and why it may not stay ("": it may)."""

    origin: str
    refusal: str = ""


class Listener:
    """Listens at one address.

    Args:
        make: Makes the protocol of a connection. A guest who may not stay is made one too, so that it can be
            told why; ``left`` is to be called when it is gone.
        rate: Connections per second on average.
        in_all: How many may stay at once.
        per_origin: How many of them from one origin.
        tls: Encrypts them; None: they are not.
        handshake: How long TLS may take, s.
        log: Where failures are told.
    """

    def __init__(
        self,
        make: Callable[[Guest], asyncio.BaseProtocol],
        *,
        rate: float,
        in_all: int,
        per_origin: int,
        tls: ssl.SSLContext | None,
        handshake: float,
        log: Log,
    ) -> None:
        self._make = make
        self._rate = rate
        self._in_all = in_all
        self._per_origin = per_origin
        self._tls = tls
        self._handshake = handshake if tls else None
        self._log = log
        self._staying: Counter[str] = Counter()
        self._leaving = 0
        self._sockets: list[socket.socket] = []
        self._timers: dict[socket.socket, asyncio.TimerHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._bucket: Bucket

    async def open(self, host: str, port: int) -> int:
        """Begin to listen; returns the port.

        Raises:
            OSError: The address cannot be listened on.
        """
        loop = asyncio.get_running_loop()
        self._bucket = Bucket(self._rate, _BURST, loop.time())
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

    def close(self) -> None:
        """Take nobody in any more; who is in stays."""
        loop = asyncio.get_running_loop()
        for timer in self._timers.values():
            timer.cancel()
        for task in self._tasks:
            task.cancel()
        for sock in self._sockets:
            loop.remove_reader(sock)
            sock.close()
        self._sockets.clear()

    def left(self, guest: Guest) -> None:
        """A connection is closed: there is room for another."""
        if guest.refusal:
            self._leaving -= 1
        else:
            self._staying[guest.origin] -= 1
            if not self._staying[guest.origin]:
                del self._staying[guest.origin]

    # --- taking in ----------------------------------------------------------------------------------------

    def _watch(self, sock: socket.socket) -> None:
        self._timers.pop(sock, None)
        asyncio.get_running_loop().add_reader(sock, self._accept, sock)

    def _rest(self, sock: socket.socket, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(sock)
        self._timers[sock] = loop.call_later(seconds, self._watch, sock)

    def _accept(self, sock: socket.socket) -> None:
        now = asyncio.get_running_loop().time()
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
            self._take(taken, origin(address[0]))

    def _take(self, taken: socket.socket, source: str) -> None:
        guest = Guest(source, self._refusal(source))
        if guest.refusal and self._leaving >= self._in_all:
            taken.close()  # too many are being told already
            return
        if guest.refusal:
            self._leaving += 1
        else:
            self._staying[source] += 1
        taken.setblocking(False)
        task = asyncio.get_running_loop().create_task(self._seat(taken, guest))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _refusal(self, source: str) -> str:
        if self._staying.total() >= self._in_all:
            return f"there are {self._in_all} connections already; try again later"
        if self._staying[source] >= self._per_origin:
            return f"there are {self._per_origin} connections from your address already; close some"
        return ""

    async def _seat(self, taken: socket.socket, guest: Guest) -> None:
        loop = asyncio.get_running_loop()
        protocol = self._make(guest)
        try:
            await loop.connect_accepted_socket(
                lambda: protocol, taken, ssl=self._tls, ssl_handshake_timeout=self._handshake
            )
        except OSError as error:
            self._log.warning("tls.failed", origin=guest.origin, error=str(error))
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
