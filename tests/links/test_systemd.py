"""Notifications of the service manager."""

import asyncio
import os
import socket

import pytest

from armgate.links.systemd import Notifier


@pytest.fixture
def manager(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.setblocking(False)
        yield sock, str(tmp_path / "notify")


async def received(sock):
    return (await asyncio.wait_for(asyncio.get_running_loop().sock_recv(sock, 4096), 20)).decode()


async def test_ready_alive_and_stopping_are_reported(manager):
    sock, path = manager
    notifier = Notifier({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "20000", "WATCHDOG_PID": str(os.getpid())})
    notifier.ready("listening")
    assert await received(sock) == "READY=1\nSTATUS=listening"
    assert [await received(sock) for _ in range(3)] == ["WATCHDOG=1"] * 3
    notifier.close()
    notifier.stopping()
    sent = [await received(sock)]
    while sent[-1] == "WATCHDOG=1":
        sent.append(await received(sock))
    assert sent[-1].startswith("STOPPING=1\n")


@pytest.mark.parametrize("more", [{}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "9", "WATCHDOG_PID": "1"}])
async def test_without_a_watchdog_for_this_process_only_ready_is_reported(manager, more):
    sock, path = manager
    Notifier({"NOTIFY_SOCKET": path, **more}).ready("x")
    assert await received(sock) == "READY=1\nSTATUS=x"
    with pytest.raises(BlockingIOError):
        sock.recv(1)


def test_without_a_manager_or_with_a_dead_one_nothing_happens(tmp_path):
    Notifier({}).stopping()
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "none")}).stopping()
    Notifier({"NOTIFY_SOCKET": "@armgate-none"}).stopping()
