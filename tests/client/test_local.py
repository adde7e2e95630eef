"""Connecting to a Unix socket whose queue is full."""

import asyncio
import socket
import threading
from contextlib import ExitStack

import pytest

from armgate.client import ConnectionLost, aio
from armgate.client.stream import Stream
from support.clients import PATIENCE


def make_room(listening):
    """Take the client that waits out of the queue."""
    listening.accept()[0].close()


@pytest.fixture
def full(tmp_path):
    """A listening socket; one client waits in its queue, which has no more room."""
    path = str(tmp_path / "cell.sock")
    with ExitStack() as stack:
        listening = stack.enter_context(socket.socket(socket.AF_UNIX))
        listening.bind(path)
        listening.listen(0)
        waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
        waiting.connect(path)
        yield path, listening


def test_a_blocking_client_waits_for_room(full):
    path, listening = full
    timer = threading.Timer(0.1, make_room, [listening])
    timer.start()
    Stream.open_local(path, PATIENCE).close()
    timer.join()


def test_a_blocking_client_waits_no_longer_than_it_may(full):
    with pytest.raises(TimeoutError, match="is full"):
        Stream.open_local(full[0], 0.1)


async def test_an_asynchronous_client_waits_for_room(full):
    path, listening = full
    asyncio.get_running_loop().call_later(0.1, make_room, listening)
    sock = await asyncio.wait_for(aio._connected(path), PATIENCE)
    assert sock.getpeername() == path
    sock.close()


async def test_an_asynchronous_client_waits_no_longer_than_it_may(full):
    with pytest.raises(ConnectionLost):
        await aio.connect(f"unix:{full[0]}", "x", timeout=0.1)
