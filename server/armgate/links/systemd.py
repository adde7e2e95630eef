"""Notification of systemd (sd_notify(3)): ready, stopping, and alive if its watchdog is on.

Each notification is a datagram of ``KEY=VALUE`` lines to the socket in ``NOTIFY_SOCKET``. Without this
variable nothing is sent.
"""

import asyncio
import contextlib
import os
import socket
from collections.abc import Mapping

_MICRO = 1e-6


class Notifier:
    """Sender of notifications to the service manager, if one started this process.

    Args:
        environment: Environment variables.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        within = environment.get("WATCHDOG_USEC", "")
        # Half of the watchdog's time, as the manual advises.
        self._every = 0.5 * int(within) * _MICRO if meant and within.isdigit() else 0.0
        self._timer: asyncio.TimerHandle | None = None

    def ready(self, status: str) -> None:
        """Report that the process is ready; from now on report that its event loop runs."""
        self._send(f"READY=1\nSTATUS={status}")
        if self._address and self._every > 0.0:
            self._alive()

    def stopping(self) -> None:
        """Report that the robots come to rest, and that the process ends then."""
        self._send("STOPPING=1\nSTATUS=robots come to rest")

    def close(self) -> None:
        """Stop reporting."""
        if self._timer is not None:
            self._timer.cancel()

    def _alive(self) -> None:
        self._send("WATCHDOG=1")
        self._timer = asyncio.get_running_loop().call_later(self._every, self._alive)

    def _send(self, text: str) -> None:
        if not self._address:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        # A notification that cannot be sent must not stop the process.
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.setblocking(False)
            sock.sendto(text.encode(), address)
