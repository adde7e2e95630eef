"""Access rules and message filter in front of viser's server, which has no settings for either."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from time import monotonic
from typing import Any

from websockets import Headers
from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response
from websockets.protocol import State

from armgate.apps.view.access import HEADERS, Access, RefusedError, without_token
from armgate.apps.view.message_filter import LARGEST, MessageFilter, ViolationError

MOST_PAGES = 32
"""Largest number of pages that are connected at the same time."""
MOST_WAITING = 64
"""Largest number of connections whose request is unanswered; a further one closes the oldest."""
RATE, BURST = 200.0, 400.0
"""Rate limit of a page's messages, 1/s, and burst; further messages wait in the page's own connection."""
STALLED = 60.0
"""Timeout of sending, s: a page that receives nothing for so long is closed, to bound its queue."""
_POLICY = 1008


class ServerGuard:
    """Rules of one server; ``filter`` is set when the server exists.

    Args:
        access: Rules of access to the page.
    """

    def __init__(self, access: Access) -> None:
        self.access = access
        self.filter: MessageFilter | None = None
        self._waiting: list[ServerConnection] = []

    def enter(self, connection: ServerConnection) -> None:
        """Make room for a new connection, so that idle ones do not use up this process's descriptors."""
        waiting = [one for one in self._waiting if _waits(one)]
        while len(waiting) >= MOST_WAITING:
            waiting.pop(0).transport.abort()
        self._waiting = [*waiting, connection]

    def connection(self, *how: Any, **more: Any) -> ServerConnection:
        """Return a connection that passes only the messages that the filter admits."""
        return _Filtered(self, *how, **more)

    def answer(self, connection: ServerConnection, request: Request, page: Any) -> Any:
        """Answer a request with a refusal, with the page, or, for a websocket, with None."""
        host, *_ = connection.local_address
        page_asked = "websocket" not in map(str.lower, request.headers.get_all("Upgrade"))
        try:
            self.access.check(request.headers, request.path, host, page=page_asked)
        except RefusedError as refused:
            return _with_headers(connection.respond(HTTPStatus.FORBIDDEN, f"armgate: {refused}\n"))
        if not page_asked:
            if len(connection.server.connections) < MOST_PAGES:
                return None
            text = f"armgate: {MOST_PAGES} pages are open already; close one\n"
            return _with_headers(connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, text))
        if self.access.has_token(request.path):
            return self._without_token(request)
        return _with_headers(page(connection, request))

    def _without_token(self, request: Request) -> Response:
        """Move the secret from the address, which users copy and browsers keep, into a cookie."""
        self.access.use_up(request.path)
        headers = Headers({"Location": without_token(request.path), "Content-Length": "0"})
        for cookie in self.access.cookies(request.headers):
            headers["Set-Cookie"] = cookie
        return _with_headers(Response(HTTPStatus.FOUND, "Found", headers))


class _Filtered(ServerConnection):
    """Connection of a page: bounded in rate, and closed if it sends an unexpected message."""

    def __init__(self, guard: ServerGuard, *how: Any, **more: Any) -> None:
        super().__init__(*how, **more)
        self._guard, self._refused = guard, False
        self._left, self._filled = BURST, monotonic()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Close the oldest waiting connection if too many wait for their request."""
        super().connection_made(transport)
        self._guard.enter(self)

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            data = await super().recv(decode)
            await self._pace()
            if not self._refused and await self._admits(data):
                return data

    async def send(self, *what: Any, **how: Any) -> None:
        try:
            async with asyncio.timeout(STALLED):
                await super().send(*what, **how)
        except TimeoutError:
            self.transport.abort()

    async def _admits(self, data: bytes | str) -> bool:
        try:
            return self._guard.filter is not None and self._guard.filter.admits(data)
        except ViolationError as violation:
            self._refused = True
            await self.close(_POLICY, f"armgate: {violation}")
            return False

    async def _pace(self) -> None:
        now = monotonic()
        self._left = min(BURST, self._left + RATE * (now - self._filled)) - 1.0
        self._filled = now
        if self._left < 0.0:
            await asyncio.sleep(-self._left / RATE)


def _waits(connection: ServerConnection) -> bool:
    return connection.state is State.CONNECTING and not connection.transport.is_closing()


def _with_headers(response: Response) -> Response:
    for name, value in HEADERS.items():
        response.headers[name] = value
    return response


@contextmanager
def guard_server(guard: ServerGuard) -> Iterator[None]:
    """Guard the viser server that is created in this context."""
    serve: Any = websockets_server.serve

    def serve_guarded(*how: Any, process_request: Any, **more: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Any:
            return guard.answer(connection, request, process_request)

        own = {"max_size": LARGEST, "create_connection": guard.connection, "process_request": answer}
        return serve(*how, **(more | own))

    setattr(websockets_server, "serve", serve_guarded)  # noqa: B010
    try:
        yield
    finally:
        setattr(websockets_server, "serve", serve)  # noqa: B010
