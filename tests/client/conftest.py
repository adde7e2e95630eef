"""Both shells of the SDK behind one awaited interface."""

import asyncio
import socket

import pytest

from armgate.client import aio, blocking
from support.fake_server import FakeConnection, FakeServer


class Awaited:
    """Blocking handle whose calls run in a thread, so that one test body works for both shells."""

    def __init__(self, handle):
        self._handle = handle

    def __getattr__(self, name):
        if name in ("ticks", "states"):
            return lambda *args, **more: self._each(name, *args, **more)
        value = getattr(self._handle, name)
        if not callable(value) or name in ("verdicts", "robot"):
            return value

        async def call(*args, **more):
            return awaited(await asyncio.to_thread(value, *args, **more))

        return call

    async def _each(self, name, *args, **more):
        items = getattr(self._handle, name)(*args, **more)
        try:
            while (item := await asyncio.to_thread(next, items, None)) is not None:
                yield item
        finally:
            items.close()

    async def __aenter__(self):
        self._handle.__enter__()
        return self

    async def __aexit__(self, *error):
        await asyncio.to_thread(self._handle.__exit__, *error)


def awaited(value):
    return Awaited(value) if isinstance(value, (blocking.Cell, blocking.Robot)) else value


@pytest.fixture
async def server():
    fake = FakeServer()
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # full soon if the server does not read
    sock.bind(("127.0.0.1", 0))
    listening = await asyncio.get_running_loop().create_server(lambda: FakeConnection(fake), sock=sock)
    fake.address = f"127.0.0.1:{listening.sockets[0].getsockname()[1]}"
    fake.listening = listening
    yield fake
    listening.close()
    for connection in fake.connections:
        connection.transport.abort()
    await listening.wait_closed()


@pytest.fixture(params=["aio", "blocking"])
def connect(request, server):
    """Return the awaited ``connect`` of one shell; it connects a client named c to the fake server."""

    async def call(name="c", **more):
        address = more.pop("address", server.address)
        if request.param == "aio":
            return await aio.connect(address, name, **more)
        return awaited(await asyncio.to_thread(blocking.connect, address, name, **more))

    return call
