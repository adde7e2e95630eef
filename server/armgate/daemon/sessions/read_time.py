"""Time up to which all messages of clients have been read.

After a stall, the daemon finds messages in its sockets that arrived in time. It must not expire a lease
before it has read them. In each turn of the event loop, asyncio first polls all sockets, then runs the
callbacks of ``call_soon`` from the turn before, then the callbacks of the sockets that the poll found. Data
that arrived before a moment t have therefore been passed to the sessions two turns after t. They have been
read once the work that is queued then is done.
"""

import asyncio
from collections.abc import Callable


class ReadTime:
    """Tracker of the time up to which messages have been read.

    Args:
        now: Daemon time, s.
        queued: Returns the number of the newest work that waits for privileged sessions; every session that
            holds a robot is privileged.
        waiting: Returns True while such work up to a number waits. Newer work does not matter: if the earlier
            work of a session is done, its leases have been renewed.
    """

    def __init__(
        self, now: Callable[[], float], queued: Callable[[], int], waiting: Callable[[int], bool]
    ) -> None:
        self._now = now
        self._queued = queued
        self._waiting = waiting
        self._time = float("-inf")
        self._following = False

    def __call__(self) -> float:
        """Return the time up to which all messages have been read, and begin to advance it to now."""
        if not self._following:
            self._following = True
            asyncio.get_running_loop().call_soon(self._polled, self._now())
        return self._time

    def _polled(self, time: float) -> None:
        asyncio.get_running_loop().call_soon(self._passed_on, time)

    def _passed_on(self, time: float) -> None:
        self._wait_for_reading(time, self._queued())

    def _wait_for_reading(self, time: float, queued: int) -> None:
        if self._waiting(queued):
            asyncio.get_running_loop().call_soon(self._wait_for_reading, time, queued)
        else:
            self._time, self._following = time, False
