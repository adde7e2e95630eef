"""Signals that an app shares: a refused one never ends its motion."""

from collections.abc import Callable

from armgate.client import Cell, Refused


class Sharing:
    """Shares signals and goes on if one is refused: another client owns its name, or the table is full.

    Args:
        cell: The connection.
        report: Prints a line for people; called once for each cause.
    """

    def __init__(self, cell: Cell, report: Callable[[str], object]) -> None:
        self._cell = cell
        self._report = report
        self._told: set[str] = set()

    def share(self, name: str, value: tuple[float, ...] | float) -> None:
        """Share a value; it is sent with the next command.

        An earlier refusal is reported instead, and this value is not sent.
        """
        try:
            self._cell.signal(name, value, more=True)
        except Refused as error:
            if error.code not in self._told:
                self._told.add(error.code)
                self._report(f"some signals are not shared: {error}")
