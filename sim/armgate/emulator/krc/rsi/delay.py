"""The Delay of RSI: count of late cycles, which are cycles without a valid reply in time."""

from collections import deque

_WINDOW = 100


class DelayCounter:
    """Delay of one RSI run, and the limits at which the run ends.

    Args:
        timeout: Tolerated number of late cycles since the start. Public sources do not state whether only
            consecutive cycles count; counting all of them is stricter.
        in_a_row: Tolerated number of consecutive late cycles; None: any number.
        share: Tolerated share of late cycles among the last hundred.
    """

    def __init__(self, timeout: int, in_a_row: int | None, share: float) -> None:
        self._timeout = timeout
        self._in_a_row = in_a_row
        self._share = share
        self._window: deque[bool] = deque(maxlen=_WINDOW)
        self._row = 0
        self.count = 0
        """Number of late cycles since the start: the Delay in telegrams."""

    def add(self, late: bool) -> str | None:
        """Count a cycle; return a description of the limit that it exceeds, if any."""
        self._row = self._row + 1 if late else 0
        self.count += late
        self._window.append(late)
        if self.count > self._timeout:
            return f"{self.count} late cycles since the start exceed Timeout {self._timeout}"
        if self._in_a_row is not None and self._row > self._in_a_row:
            return f"{self._row} late cycles in a row exceed the limit of this controller, {self._in_a_row}"
        if len(self._window) == _WINDOW and sum(self._window) > self._share * _WINDOW:
            return f"{sum(self._window)} of the last {_WINDOW} cycles were late"
        return None
