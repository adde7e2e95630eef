"""Tells systemd how the daemon is (sd_notify(3)): ready, stopping, and alive where it watches.

A datagram of ``KEY=VALUE`` lines to the socket that ``NOTIFY_SOCKET`` names; without it nobody is told.
"""

import asyncio
import contextlib
import os
import socket
from collections.abc import Mapping

_MICRO = 1e-6


class Notifier:
    """Speaks to the service manager that started this process, if one did.

    Args:
        environment: Where it says how.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        within = environment.get("WATCHDOG_USEC", "")
        # Half of what is allowed, as the manual advises.
        self._every = 0.5 * int(within) * _MICRO if meant and within.isdigit() else 0.0
        self._timer: asyncio.TimerHandle | None = None

    def ready(self, status: str) -> None:
        """Clients may connect; from now on the event loop says that it turns."""
        self._send(f"READY=1\nSTATUS={status}")
        if self._address and self._every > 0.0:
            self._alive()

    def stopping(self) -> None:
        """The robots come to rest, then the process ends."""
        self._send("STOPPING=1\nSTATUS=robots come to rest")

    def close(self) -> None:
        """Say no more."""
        if self._timer is not None:
            self._timer.cancel()

    def _alive(self) -> None:
        self._send("WATCHDOG=1")
        self._timer = asyncio.get_running_loop().call_later(self._every, self._alive)

    def _send(self, text: str) -> None:
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        # Never in the way: who does not listen is not told.
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.setblocking(False)
            sock.sendto(text.encode(), address)
