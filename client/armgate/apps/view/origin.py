"""Lets only the viewer's own page speak to it: browsers let any site's page open a socket to this machine."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

TOLD = "this viewer is for its own page only\n"


def foreign(headers: Mapping[str, str]) -> bool:
    """Whether a request comes from another site's page; programs, which name no origin, are not meant."""
    origin = headers.get("Origin")
    return origin is not None and urlsplit(origin).netloc != headers.get("Host")


@contextmanager
def own_page_only() -> Iterator[None]:
    """A server of viser that is made meanwhile refuses other sites' pages; viser has no setting for it."""
    from websockets.asyncio import server  # noqa: PLC0415

    serve: Any = server.serve

    def guarded(*how: Any, process_request: Any, **more: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            if foreign(request.headers):
                return connection.respond(HTTPStatus.FORBIDDEN, TOLD)
            return process_request(connection, request)

        return serve(*how, process_request=check, **more)

    setattr(server, "serve", guarded)  # noqa: B010
    try:
        yield
    finally:
        setattr(server, "serve", serve)  # noqa: B010
