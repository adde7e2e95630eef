"""End of one connection: its deadline, and the reports to the host, each made once.

A connection is open, then closing, then closed. While it is closing, a last message is written, and
further messages of the client are discarded. The session has *left* as soon as its leases must end, which
may be before the connection is closed.
"""

import asyncio
from collections.abc import Callable


class Ending:
    """Progress of the end of one connection.

    Args:
        left: Called once with the reason when the session has left.
        closed: Called once when the connection is closed.
    """

    def __init__(self, left: Callable[[str], None], closed: Callable[[], None]) -> None:
        self._report_left = left
        self._report_closed = closed
        self._closing = self._left = self._closed = False
        self._reason = ""
        self._deadline: asyncio.TimerHandle | None = None

    @property
    def closing(self) -> bool:
        """True if nothing more is received or sent."""
        return self._closing

    def begin(self, reason: str = "") -> bool:
        """Begin to close the connection.

        Args:
            reason: Reason to report when the session leaves; replaces the reason given to `leave`.

        Returns:
            False if it is closing already.
        """
        self._reason = reason or self._reason
        begun, self._closing = not self._closing, True
        return begun

    def leave(self, reason: str) -> None:
        """Report that the session has left, unless that was reported before."""
        if not self._left:
            self._left = True
            self._report_left(self._reason or reason)

    def finish(self) -> None:
        """Report that the connection is closed, unless that was reported before."""
        if not self._closed:
            self._closed = True
            self._report_closed()

    def set_deadline(self, seconds: float, act: Callable[[], None]) -> None:
        """Call ``act`` after some seconds, in place of an earlier deadline."""
        self.clear_deadline()
        self._deadline = asyncio.get_running_loop().call_later(seconds, act)

    def clear_deadline(self) -> None:
        """Drop the deadline."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
