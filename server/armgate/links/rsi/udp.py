"""UDP sockets for a KRC's telegrams: one to answer on, and one that only listens."""

import asyncio
import socket
import time
from collections.abc import Callable

from armgate.links.rsi.setup import Address


def bound(address: Address) -> socket.socket:
    """A socket on an address; it never blocks.

    Raises:
        OSError: It cannot be listened on; says which, and what was expected.
    """
    try:
        family, kind, _, _, found = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        own = socket.socket(family, kind)
    except OSError as error:
        raise _said(address, error) from error
    try:
        own.setblocking(False)
        own.bind(found)
    except OSError as error:
        own.close()
        raise _said(address, error) from error
    return own


def _said(address: Address, error: OSError) -> OSError:
    text = f"{error.strerror}; expected an address of this machine, and a port that nobody else listens on"
    return OSError(error.errno, text, f"UDP {address[0]}:{address[1]}")


Take = Callable[[bytes, str, float], None]
"""Told of a datagram: its bytes, from which address, when (s)."""


class _Ear(asyncio.DatagramProtocol):
    def __init__(self, take: Take) -> None:
        self._take = take
        self.heard = asyncio.Event()

    def datagram_received(self, data: bytes, source: tuple[str, int]) -> None:
        self._take(data, source[0], time.monotonic())
        self.heard.set()


async def listen(
    address: Address, take: Take, seconds: float, wait: float, ready: Callable[[], None] = lambda: None
) -> None:
    """Hands on all datagrams that come within ``seconds`` after the first, which may take ``wait`` s.

    Raises:
        OSError: The address cannot be listened on.
    """
    ear = _Ear(take)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: ear, sock=bound(address))
    ready()
    try:
        try:
            await asyncio.wait_for(ear.heard.wait(), wait)
        except TimeoutError:
            return
        await asyncio.sleep(seconds)
    finally:
        transport.close()
