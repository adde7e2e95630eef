"""Listens on a UDP address and never answers."""

import asyncio
import time
from collections.abc import Callable

from armgate.links.rsi.setup import Address
from armgate.links.rsi.udp import bound

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
