"""Time up to which everything that clients sent has been read.

A daemon that was stalled finds messages in its sockets that came in time. It must not end a lease for
silence before it has read them. asyncio polls all sockets once in each turn of the event loop, and runs
callbacks of ``call_soon`` from the turn before ahead of what the poll found. So what was sent before some
moment has been handed to the sessions two turns later, and has been read when none waits for its turn.
"""

import asyncio
from collections.abc import Callable


class Heard:
    """Follows the time with what was read.

    Args:
        now: Daemon time, s.
        waiting: Returns True while sessions that hold a robot wait to read on.
    """

    def __init__(self, now: Callable[[], float], waiting: Callable[[], bool]) -> None:
        self._now = now
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
        asyncio.get_running_loop().call_soon(self._read, time)

    def _read(self, time: float) -> None:
        if self._waiting():
            asyncio.get_running_loop().call_soon(self._read, time)
        else:
            self._time, self._following = time, False
