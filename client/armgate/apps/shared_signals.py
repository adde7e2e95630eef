"""Signals that a controller shares; a refused signal never ends its motion."""

from collections.abc import Callable

from armgate.client import Cell, Refused


class SharedSignals:
    """Signals of one controller, sent with its commands.

    After a refusal, for example because another client owns the name, the other signals are still sent.

    Args:
        cell: The connection.
        report: Prints a line for users; called once per cause.
    """

    def __init__(self, cell: Cell, report: Callable[[str], object]) -> None:
        self._cell = cell
        self._report = report
        self._reported: set[str] = set()

    def share(self, name: str, value: tuple[float, ...] | float) -> None:
        """Share a value; the next command sends it.

        If an earlier signal was refused, the refusal is reported and this value is not sent.
        """
        try:
            self._cell.signal(name, value, more=True)
        except Refused as error:
            if error.code not in self._reported:
                self._reported.add(error.code)
                self._report(f"some signals are not shared: {error}")
