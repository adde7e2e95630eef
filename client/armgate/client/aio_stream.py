"""Stream of the asyncio shell: passes bytes between the transport and the session."""

import asyncio
import socket
import ssl
from time import monotonic
from typing import Any

from armgate.client.address import parse_address, socket_path
from armgate.client.blocking_stream import RETRY
from armgate.client.security import check_no_tls
from armgate.client.session import Session


class Stream(asyncio.Protocol):
    """Stream of one session: passes received bytes to the session and wakes the tasks that wait."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._changed = asyncio.Event()
        self._writable = asyncio.Event()
        self._writable.set()
        self._transport: asyncio.Transport

    async def open(self, address: str, tls: ssl.SSLContext | None) -> None:
        """Connect to ``HOST:PORT`` or ``unix:PATH``.

        Raises:
            BadArgument: The address is invalid, or TLS is requested on a Unix socket.
            OSError: No daemon listens there, or TLS fails.
        """
        loop = asyncio.get_running_loop()
        path = socket_path(address)
        if path is None:
            await loop.create_connection(lambda: self, *parse_address(address), ssl=tls)
        else:
            check_no_tls(address, tls)
            await loop.create_unix_connection(lambda: self, sock=await _unix(path))

    @property
    def peer(self) -> Any:
        """Address of the peer."""
        return self._transport.get_extra_info("peername")

    def write(self, data: bytes) -> None:
        """Pass bytes to the transport."""
        self._transport.write(data)
        self.session.sent(monotonic())

    async def wait(self, timeout: float) -> None:  # noqa: ASYNC109 (a bound, not an error)
        """Wait until the session has changed, at most for ``timeout``."""
        self._changed.clear()
        await _bounded(self._changed, timeout)

    async def drain(self, timeout: float) -> bool:  # noqa: ASYNC109 (a bound, not an error)
        """Wait until the transport accepts more bytes; return False after ``timeout``."""
        return await _bounded(self._writable, timeout)

    def close(self) -> None:
        """Close the stream after all bytes are written."""
        self._transport.close()

    # --- called by the transport ---------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Pass received bytes to the session."""
        self.session.receive(data)
        self._changed.set()

    def eof_received(self) -> None:
        """Pass the end of the server's stream to the session."""
        self.session.receive_eof()
        self._changed.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass the end of the connection to the session, and wake all tasks."""
        self.session.receive_eof(f"the connection broke ({exc or 'closed'})")
        self._changed.set()
        self._writable.set()

    def pause_writing(self) -> None:
        """Stop writing: the server reads too slowly."""
        self._writable.clear()

    def resume_writing(self) -> None:
        """Resume writing."""
        self._writable.set()


async def _unix(path: str) -> socket.socket:
    """Connect to a Unix socket; retry while its queue is full, which asyncio reports as success."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    sock.setblocking(False)
    try:
        while True:
            try:
                sock.connect(path)
            except BlockingIOError:
                await asyncio.sleep(RETRY)
            else:
                return sock
    except BaseException:
        sock.close()
        raise


async def _bounded(event: asyncio.Event, timeout: float) -> bool:  # noqa: ASYNC109 (a bound, not an error)
    """Wait for an event; return False after ``timeout``."""
    try:
        async with asyncio.timeout(None if timeout == float("inf") else timeout):
            await event.wait()
    except TimeoutError:
        return False
    return True
