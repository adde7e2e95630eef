"""Listener: accepts connections at a bounded rate, up to a bounded number.

These bounds apply before TLS, because its handshake costs more than all that follows. Connections that
cannot be accepted yet wait in the kernel's queue, so that connected clients are not delayed.
"""

import asyncio
import socket
import ssl
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from time import monotonic

from armgate.daemon.auth.address import origin
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.unix_socket import UnixSocket
from armgate.daemon.sessions import tls_stream
from armgate.daemon.sessions.connection_limits import ConnectionLimits, Slot
from armgate.daemon.sessions.scheduler import Work
from armgate.links.log import Log
from armgate.links.robot_server.unix_socket import peer_uid
from armgate.world.token_bucket import TokenBucket

_QUEUE = 128
"""Number of connections that may wait in the kernel."""

_AT_ONCE = 4
"""Largest number of connections accepted in one turn of the event loop."""

_BURST = 32.0
"""Largest number of connections accepted at once after a quiet time."""

_LEAVING = 128
"""Largest number of refused connections that are sent the reason; more are closed without a message."""

_RETRY = 1.0
"""Time to wait if the system has no more descriptors or memory, s."""


class ConnectionProtocol(asyncio.BaseProtocol, ABC):
    """Asyncio protocol of one connection; made by the listener."""

    @abstractmethod
    def evict(self) -> None:
        """Close the connection to make room for another one: no hello came."""

    @abstractmethod
    def serve(self, work: Work) -> None:
        """Do work of this connection in its turn."""


class Listener:
    """Listener on one address, and on a Unix socket.

    Args:
        make: Makes the protocol of a connection, also of a refused one, so that the reason can be sent to its
            client; it must call `left` when the connection is closed.
        limits: Counts the connections.
        rate: Connections accepted per second, on average.
        tls: Encrypts connections; None: they are not encrypted.
        handshake: Time that the handshake of TLS may take, s.
        log: Receives failures.
        refused: Counts refused connections, and bounds their log.
    """

    def __init__(
        self,
        make: Callable[[Slot], ConnectionProtocol],
        limits: ConnectionLimits,
        *,
        rate: float,
        tls: ssl.SSLContext | None,
        handshake: float,
        log: Log,
        refused: FailureLog,
    ) -> None:
        self._refused = refused
        self._make = make
        self._limits = limits
        self._tls = tls
        self._handshake = handshake
        self._log = log
        self._leaving: set[Slot] = set()
        self._protocols: dict[Slot, ConnectionProtocol] = {}
        self._handshakes: dict[Slot, asyncio.Task[None]] = {}
        self._sockets: list[socket.socket] = []
        self._timers: dict[socket.socket, asyncio.TimerHandle] = {}
        self._local: UnixSocket | None = None
        self._bucket = TokenBucket(rate, _BURST, monotonic())

    async def open(self, host: str, port: int) -> int:
        """Begin to listen; return the port.

        Raises:
            OSError: The address cannot be listened on.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        try:
            for family, _, _, _, address in dict.fromkeys(found):
                self._sockets.append(_bound(family, (address[0], port, *address[2:])))
                # If the port is 0, the system chooses one for the first address; the others use the same.
                port = self._sockets[-1].getsockname()[1]
        except OSError:
            self.close()
            raise
        for sock in self._sockets:
            self._resume(sock)
        return port

    def open_local(self, path: Path) -> None:
        """Begin to listen on a Unix socket too.

        Raises:
            UnixSocketError: The socket cannot be listened on.
        """
        self._local = UnixSocket(path)
        self._resume(self._local.socket)

    def use_tls(self, tls: ssl.SSLContext) -> dict[str, object]:
        """Encrypt new connections with these certificates; return no fields for the log."""
        self._tls = tls
        return {}

    def close(self) -> None:
        """Stop accepting; accepted connections stay."""
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

    def left(self, slot: Slot) -> None:
        """Free the place of a connection that is closed."""
        self._leaving.discard(slot)
        self._protocols.pop(slot, None)
        self._limits.leave(slot)

    # --- accepting -----------------------------------------------------------------------------------------

    def _resume(self, sock: socket.socket) -> None:
        self._timers.pop(sock, None)
        asyncio.get_running_loop().add_reader(sock, self._accept, sock)

    def _pause(self, sock: socket.socket, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(sock)
        self._timers[sock] = loop.call_later(seconds, self._resume, sock)

    def _accept(self, sock: socket.socket) -> None:
        now = monotonic()
        for _ in range(_AT_ONCE):
            if wait := self._bucket.wait(now):
                self._pause(sock, wait)
                return
            try:
                taken, address = sock.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:  # the system has no more descriptors or memory; this may pass
                self._log.error("accept", error=str(error))
                self._pause(sock, _RETRY)
                return
            self._bucket.take(now)
            self._take(taken, address)

    def _take(self, taken: socket.socket, address: tuple[str, int] | str) -> None:
        uid = peer_uid(taken) if taken.family == socket.AF_UNIX else None
        source = origin(address[0]) if uid is None else f"uid {uid}"
        slot, evicted = self._limits.enter(source, uid)
        if evicted is not None:
            self._evict(evicted)
        if slot.refusal:
            if len(self._leaving) >= _LEAVING:
                taken.close()
                return
            self._leaving.add(slot)
        taken.setblocking(False)
        task = asyncio.get_running_loop().create_task(self._connect(taken, slot))
        self._handshakes[slot] = task
        task.add_done_callback(lambda done: self._connected(done, taken, slot))

    def _connected(self, done: asyncio.Task[None], taken: socket.socket, slot: Slot) -> None:
        self._handshakes.pop(slot, None)
        if done.cancelled():
            if slot not in self._protocols:
                taken.close()  # cancelled before it began
            self.left(slot)

    def _evict(self, slot: Slot) -> None:
        task = self._handshakes.get(slot)
        if task is not None and not task.done():
            task.cancel()
        elif (protocol := self._protocols.get(slot)) is not None:
            self._leaving.add(slot)
            protocol.evict()

    async def _connect(self, taken: socket.socket, slot: Slot) -> None:
        loop = asyncio.get_running_loop()
        protocol = self._protocols[slot] = self._make(slot)
        try:
            if self._tls is None or slot.uid is not None:
                await loop.connect_accepted_socket(lambda: protocol, taken)
            else:
                await tls_stream.accept(taken, protocol, self._tls, self._handshake, protocol.serve)
        except OSError as error:
            self._refused.note(self._log, "tls.failed", slot.origin, monotonic(), error=str(error))
            self.left(slot)


def _bound(family: int, address: tuple[str | int, ...]) -> socket.socket:
    # asyncio turns off Nagle's algorithm only for sockets that name their protocol.
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
