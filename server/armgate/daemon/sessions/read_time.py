"""Time up to which everything that clients sent has been read.

A daemon that was stalled finds messages in its sockets that came in time. It must not end a lease for
silence before it has read them. asyncio polls all sockets once in each turn of the event loop, and runs
callbacks of ``call_soon`` from the turn before ahead of what the poll found. So what was sent before some
moment has been handed to the sessions two turns later, and has been read when the work that waits then is
done.
"""

import asyncio
from collections.abc import Callable


class ReadTime:
    """Follows the time with what was read.

    Args:
        now: Daemon time, s.
        queued: Returns the number of the newest work that waits for sessions that hold a robot.
        waiting: Returns True while such work up to a number waits. Newer work is not waited for: the lease of
            a session whose earlier work is done was renewed since.
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
        """Return the time up to which everything has been read, and begin to follow up to now."""
        if not self._following:
            self._following = True
            asyncio.get_running_loop().call_soon(self._polled, self._now())
        return self._time

    def _polled(self, time: float) -> None:
        asyncio.get_running_loop().call_soon(self._handed, time)

    def _handed(self, time: float) -> None:
        self._read(time, self._queued())

    def _read(self, time: float, queued: int) -> None:
        if self._waiting(queued):
            asyncio.get_running_loop().call_soon(self._read, time, queued)
        else:
            self._time, self._following = time, False
