"""UDP sockets for a KRC's telegrams: one to answer on, and one that only listens."""

import asyncio
import socket
import time
from collections.abc import Callable

from armgate.links.rsi.setup import Address


def bound(address: Address) -> socket.socket:
    """Return a non-blocking socket on an address.

    Raises:
        OSError: It is not possible to listen on the address; the text names it and what was expected.
    """
    try:
        family, kind, _, _, found = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        own = socket.socket(family, kind)
    except OSError as error:
        raise _explained(address, error) from error
    try:
        own.setblocking(False)
        own.bind(found)
    except OSError as error:
        own.close()
        raise _explained(address, error) from error
    return own


def _explained(address: Address, error: OSError) -> OSError:
    text = f"{error.strerror}; expected an address of this machine, and a port that no other process uses"
    return OSError(error.errno, text, f"UDP {address[0]}:{address[1]}")


Take = Callable[[bytes, str, float], None]
"""Function that takes a datagram: its bytes, the address that sent it, the time of its arrival (s)."""


class _Listener(asyncio.DatagramProtocol):
    def __init__(self, take: Take) -> None:
        self._take = take
        self.received = asyncio.Event()

    def datagram_received(self, data: bytes, source: tuple[str, int]) -> None:
        self._take(data, source[0], time.monotonic())
        self.received.set()


async def listen(
    address: Address, take: Take, seconds: float, wait: float, ready: Callable[[], None] = lambda: None
) -> None:
    """Pass on all datagrams, without answering any.

    Args:
        address: Address and port to listen on.
        take: Called with each datagram.
        seconds: Time to listen after the first datagram, s.
        wait: Longest time to wait for the first datagram, s.
        ready: Called once the socket is open.

    Raises:
        OSError: It is not possible to listen on the address.
    """
    listener = _Listener(take)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: listener, sock=bound(address))
    ready()
    try:
        try:
            await asyncio.wait_for(listener.received.wait(), wait)
        except TimeoutError:
            return
        await asyncio.sleep(seconds)
    finally:
        transport.close()
