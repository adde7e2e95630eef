"""Connection to a Unix socket whose queue is full."""

import asyncio
import socket
import threading
from contextlib import ExitStack

import pytest

from armgate.client import ConnectionLost, aio
from armgate.client.aio_stream import Stream as AioStream
from armgate.client.blocking_stream import Stream
from armgate.client.session import Session
from support.clients import PATIENCE


def make_room(listening):
    """Accept and close the waiting client."""
    listening.accept()[0].close()


@pytest.fixture
def full(tmp_path):
    """Yield a path and its listening socket; one client waits in the queue, which is then full."""
    path = str(tmp_path / "cell.sock")
    with ExitStack() as stack:
        listening = stack.enter_context(socket.socket(socket.AF_UNIX))
        listening.bind(path)
        listening.listen(0)
        waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
        waiting.connect(path)
        yield path, listening


def test_a_blocking_client_waits_until_the_queue_has_room(full):
    path, listening = full
    timer = threading.Timer(0.1, make_room, [listening])
    timer.start()
    Stream.open(f"unix:{path}", PATIENCE, None).close()
    timer.join()


def test_a_blocking_client_waits_at_most_for_the_timeout(full):
    with pytest.raises(TimeoutError, match="is full"):
        Stream.open(f"unix:{full[0]}", 0.1, None)


async def test_an_asyncio_client_waits_until_the_queue_has_room(full):
    path, listening = full
    asyncio.get_running_loop().call_later(0.1, make_room, listening)
    stream = AioStream(Session())
    await asyncio.wait_for(stream.open(f"unix:{path}", None), PATIENCE)
    assert stream.peer == path
    stream.close()


async def test_an_asyncio_client_waits_at_most_for_the_timeout(full):
    with pytest.raises(ConnectionLost):
        await aio.connect(f"unix:{full[0]}", "x", timeout=0.1)
