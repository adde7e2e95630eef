"""Checks of a daemon from inside: its queues are bounded, and it keeps no data of disconnected clients."""

from typing import Any

from tools.simulate.findings import Findings
from tools.simulate.stack import Life

_TRANSPORT = 1 << 20
"""Bytes that asyncio may keep for one client: the largest answer, and what was sent with it."""

_READ = 400 * 1024
"""Bytes of one client that may wait to be read."""

_RECORDS = 514
"""Records that may wait for the disk: the configured queue, a gap and the end."""


class DaemonChecks:
    """Checks of daemons.

    Args:
        findings: Receives violations.
        limits: Configuration of the server.
        robots: Number of robots.
    """

    def __init__(self, findings: Findings, limits: Any, robots: int) -> None:
        self._findings, self._limits, self._robots = findings, limits, robots

    def running(self, life: Life) -> None:
        """Check the bounds of memory."""
        daemon: Any = life.daemon
        queues = daemon._queues()
        self._bound("sessions are bounded", queues["sessions"], self._limits.max_connections + 128)
        self._bound("records are bounded", queues.get("recorder", 0), _RECORDS)
        for session in daemon._sessions._sessions:
            writer = session._writer
            self._bound("answers that wait are bounded", writer._queued, self._limits.send_buffer)
            self._bound("states that wait are bounded", len(writer._states), self._robots)
            size = session._transport.get_write_buffer_size()
            self._bound("unsent bytes are bounded", size, _TRANSPORT)
            self._bound("unread bytes are bounded", session._connection.buffered, _READ)

    def idle(self, life: Life) -> None:
        """Check that no data of disconnected clients is kept."""
        daemon: Any = life.daemon
        core, sessions = daemon._core, daemon._sessions
        left = {
            "connections": len(sessions._sessions),
            "sessions": len(core.peers),
            "leases": len(core.leasing.sessions),
            "subscriptions": len(core._states._subscriptions),
            "unsent states": len(core._states._unsent),
            "signals": len(core._signals.values),
            "tokens": len(sessions._login._tokens),
            "protocols": len(sessions._listener._protocols),
            "handshakes": len(sessions._listener._handshakes),
            "places": 0 if sessions._listener._limits.empty else 1,
        }
        some = {key: number for key, number in left.items() if number}
        self._findings.check(not some, "no data of disconnected clients", lambda: str(some))

    def _bound(self, invariant: str, value: int, bound: int) -> None:
        if value > bound:
            self._findings.report(invariant, f"{value} > {bound}")
