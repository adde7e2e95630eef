"""Counts cycles without a valid reply in time, and says when there were too many."""

from collections import deque

_WINDOW = 100


class Lateness:
    """The Delay of one RSI run.

    Args:
        timeout: So many are borne since the start: public sources leave open whether they have to be
            consecutive, and this is the harder reading.
        in_a_row: So many in a row are borne; None: any number.
        share: So large a share of the last hundred is borne.
    """

    def __init__(self, timeout: int, in_a_row: int | None, share: float) -> None:
        self._timeout = timeout
        self._in_a_row = in_a_row
        self._share = share
        self._window: deque[bool] = deque(maxlen=_WINDOW)
        self._row = 0
        self.count = 0
        """Late cycles since the start: the Delay that telegrams carry."""

    def note(self, late: bool) -> str | None:
        """Count a cycle; what was exceeded, if anything was."""
        self._row = self._row + 1 if late else 0
        self.count += late
        self._window.append(late)
        if self.count > self._timeout:
            return f"{self.count} late cycles since the start, Timeout is {self._timeout}"
        if self._in_a_row is not None and self._row > self._in_a_row:
            return f"{self._row} late cycles in a row, this controller bears {self._in_a_row}"
        if len(self._window) == _WINDOW and sum(self._window) > self._share * _WINDOW:
            return f"{sum(self._window)} of the last {_WINDOW} cycles were late"
        return None
