"""HTTP server of the metrics: one page, on this machine only, in its own thread.

All resources are bounded: the rate at which connections are accepted, the number of open connections, and the
time for request and answer. If too many connections are open, the oldest one is closed. Idle or numerous
connections therefore use up no threads or descriptors that the daemon needs.
"""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable
from time import monotonic

from armgate.daemon.auth.address import is_loopback
from armgate.world.token_bucket import TokenBucket

_HOST = "127.0.0.1"
_PATHS = ("/", "/metrics")
_OPEN = 16
"""Number of connections that may be open at once."""
_RATE, _BURST = 50.0, 8.0
"""Connections accepted per second, and in one burst.

Each connection stays open for at least (_OPEN - _BURST) / _RATE s before newer ones can replace it.
"""
_TIMEOUT = 5.0
"""Time for a request and its answer, s."""
_REQUEST = 8192
"""Largest request, bytes."""
_RETRY = 1.0
"""Time to wait if the system has no more descriptors or memory, s."""


class MetricsServer:
    """HTTP server of one page.

    Args:
        page: Returns the page; called in the thread of the server.
        content_type: Content type of the page.
    """

    def __init__(self, page: Callable[[], bytes], content_type: str) -> None:
        self._page = page
        self._content_type = content_type
        self._open: dict[asyncio.Task[None], socket.socket] = {}
        self._socket: socket.socket
        self._loop: asyncio.AbstractEventLoop
        self._serving: asyncio.Task[None]
        self._thread = threading.Thread(target=self._run, name="metrics", daemon=True)

    def open(self, port: int) -> int:
        """Listen on loopback and serve; return the port.

        Raises:
            OSError: The port cannot be listened on.
        """
        self._socket = socket.create_server((_HOST, port), backlog=_OPEN)
        self._socket.setblocking(False)
        self._loop = asyncio.new_event_loop()
        self._serving = self._loop.create_task(self._serve())
        self._thread.start()
        return int(self._socket.getsockname()[1])

    def close(self) -> None:
        """Close all connections and end the thread."""
        self._loop.call_soon_threadsafe(self._serving.cancel)
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._serving)
        self._loop.close()

    async def _serve(self) -> None:
        bucket = TokenBucket(_RATE, _BURST, monotonic())
        try:
            while True:
                await asyncio.sleep(bucket.reserve(monotonic()))
                await self._connection_waits()
                try:
                    self._take(self._socket.accept()[0])
                except (BlockingIOError, ConnectionAbortedError):
                    pass
                except OSError:  # the system has no more descriptors or memory; this may pass
                    await asyncio.sleep(_RETRY)
        finally:
            open_ = dict(self._open)
            for task in open_:
                task.cancel()
            await asyncio.gather(*open_, return_exceptions=True)
            for taken in open_.values():
                taken.close()

    async def _connection_waits(self) -> None:
        """Wait until a connection is in the queue of the system."""
        waiting = asyncio.Event()
        self._loop.add_reader(self._socket, waiting.set)
        try:
            await waiting.wait()
        finally:
            self._loop.remove_reader(self._socket)

    def _take(self, taken: socket.socket) -> None:
        taken.setblocking(False)
        task = self._loop.create_task(self._answer(taken))
        task.add_done_callback(self._leave)
        self._open[task] = taken
        if len(self._open) > _OPEN:
            next(iter(self._open)).cancel()

    def _leave(self, task: asyncio.Task[None]) -> None:
        self._open.pop(task).close()

    async def _answer(self, taken: socket.socket) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(_TIMEOUT):
                answer = self._answer_to(await self._request(taken))
                await self._loop.sock_sendall(taken, answer)
                taken.shutdown(socket.SHUT_WR)
                while await self._loop.sock_recv(taken, _REQUEST):
                    pass  # a socket closed with unread bytes would discard the answer

    async def _request(self, taken: socket.socket) -> bytes:
        """Return the head of a request, or the part of it that arrived."""
        head = b""
        while b"\r\n\r\n" not in head and b"\n\n" not in head and len(head) < _REQUEST:
            data = await self._loop.sock_recv(taken, _REQUEST)
            if not data:
                break
            head += data
        return head

    def _answer_to(self, request: bytes) -> bytes:
        line, *headers = request.decode("latin-1").splitlines() or [""]
        method, _, rest = line.partition(" ")
        path = rest.partition(" ")[0].partition("?")[0]
        if method not in ("GET", "HEAD"):
            return _response("405 Method Not Allowed", b"expected GET\n")
        if not _is_own(headers):
            return _response("403 Forbidden", b"expected a Host of this machine, such as localhost\n")
        if path not in _PATHS:
            return _response("404 Not Found", b"expected /metrics\n")
        answer = _response("200 OK", self._page(), self._content_type)
        return answer if method == "GET" else answer.partition(b"\r\n\r\n")[0] + b"\r\n\r\n"


def _is_own(headers: list[str]) -> bool:
    """Return True if the request names this machine; a request of another website names another host."""
    hosts = [
        value.strip() for name, _, value in (h.partition(":") for h in headers) if name.lower() == "host"
    ]
    return all(is_loopback(_name(host)) for host in hosts)


def _name(host: str) -> str:
    return host[1:].partition("]")[0] if host.startswith("[") else host.partition(":")[0]


def _response(status: str, body: bytes, content_type: str = "text/plain; charset=utf-8") -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\nContent-Length: {len(body)}\r\n"
    return (head + "Connection: close\r\nX-Content-Type-Options: nosniff\r\n\r\n").encode() + body
