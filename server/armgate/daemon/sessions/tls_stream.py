"""TLS of one connection: a client's data are decrypted in small pieces, each in a turn of its session.

Decryption costs time before any message is complete: for handshakes, key updates (TLS 1.3) and records of one
byte. asyncio itself would decrypt up to 256 KiB at once, of every connection in every turn of the event loop.
"""

import asyncio
import socket
import ssl
from asyncio.sslproto import SSLProtocol
from collections.abc import Callable
from typing import Any, cast

_PIECE = 2048
"""Bytes that are decrypted at once: up to 75 key updates, about 1 ms."""

Serve = Callable[[Callable[[], None]], None]
"""Function that does work in the turn of a session."""


async def accept(
    sock: socket.socket,
    protocol: asyncio.BaseProtocol,
    context: ssl.SSLContext,
    handshake: float,
    serve: Serve,
) -> None:
    """Encrypt an accepted connection; return when the handshake is over.

    Args:
        sock: Its socket.
        protocol: Protocol of the decrypted data; connected when the handshake is over.
        context: Certificate and key.
        handshake: Time that the handshake may take, s.
        serve: Does work in this connection's turn.

    Raises:
        OSError: The handshake failed.
    """
    loop = asyncio.get_running_loop()
    over = loop.create_future()
    tls = _tls(loop, protocol, context, over, handshake)
    under, _ = await loop.connect_accepted_socket(lambda: _Pieces(tls, serve), sock)
    try:
        await over
    except BaseException:
        under.abort()
        raise


class _Tls(SSLProtocol):
    """TLS of asyncio, with a small buffer for incoming data."""

    max_size = _PIECE


def _tls(
    loop: asyncio.AbstractEventLoop,
    protocol: asyncio.BaseProtocol,
    context: ssl.SSLContext,
    over: asyncio.Future[None],
    handshake: float,
) -> Any:  # the stub accepts only whole seconds, and lacks the method called below
    tls: Any = _Tls
    made = tls(loop, protocol, context, over, server_side=True, ssl_handshake_timeout=handshake)
    # While the session is not read, at most this many bytes wait to be decrypted at once.
    made._set_read_buffer_limits(high=_PIECE)
    return made


class _Valve:
    """Encrypted transport as TLS sees it; read only if neither TLS nor a waiting piece forbids it."""

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._paused = self._waits = False

    def pause_reading(self) -> None:
        """Stop reading until TLS permits it again."""
        self._paused = True
        self._set()

    def resume_reading(self) -> None:
        """Read again, unless a piece waits."""
        self._paused = False
        self._set()

    def wait(self, waits: bool) -> None:
        """Stop reading while a piece waits for its turn."""
        self._waits = waits
        self._set()

    def _set(self) -> None:
        if self._paused or self._waits:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)


class _Pieces(asyncio.BufferedProtocol):
    """Encrypted input of one connection, decrypted piece by piece.

    Args:
        tls: Decrypts the input.
        serve: Does work in this connection's turn.
    """

    def __init__(self, tls: Any, serve: Serve) -> None:
        self._tls = tls
        self._serve = serve
        self._room = memoryview(bytearray(_PIECE))
        self._valve: _Valve
        self._lost = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin the handshake."""
        # Data wait in the session to be written, as without TLS.
        cast(asyncio.Transport, transport).set_write_buffer_limits(high=1, low=0)
        self._valve = _Valve(cast(asyncio.Transport, transport))
        self._tls.connection_made(self._valve)

    def connection_lost(self, exc: Exception | None) -> None:
        """Report the loss to TLS."""
        self._lost = True
        self._tls.connection_lost(exc)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the memory for the next piece."""
        return self._room

    def buffer_updated(self, nbytes: int) -> None:
        """Decrypt a piece in its turn, and read no other piece before."""
        self._valve.wait(True)
        self._serve(lambda: self._decrypt(nbytes))

    def _decrypt(self, nbytes: int) -> None:
        if not (self._lost or self._valve.is_closing()):
            self._valve.wait(False)
            self._tls.get_buffer(nbytes)[:nbytes] = self._room[:nbytes]
            self._tls.buffer_updated(nbytes)

    def eof_received(self) -> bool | None:
        """Report the end of the stream to TLS; return True if TLS keeps the transport open."""
        stays: bool | None = self._tls.eof_received()
        return stays

    def pause_writing(self) -> None:
        """Stop writing encrypted data: the transport accepts no more."""
        self._tls.pause_writing()

    def resume_writing(self) -> None:
        """Write encrypted data again."""
        self._tls.resume_writing()
