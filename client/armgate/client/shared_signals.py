"""Signals that a controller shares; a refused signal never ends its motion."""

from collections.abc import Callable, Iterable
from typing import Protocol

from armgate.client.errors import Refused


class SignalCell(Protocol):
    """Connection on which signals are shared, such as `Cell`."""

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Share a number or a short vector; with ``more``, together with the next message.

        Raises:
            Refused: An earlier signal was refused.
        """


class SharedSignals:
    """Signals of one controller, sent with its commands.

    After a refusal, for example because another client owns the name, the other signals are still sent.

    Args:
        cell: The connection.
        report: Prints a line for users; called once per cause.
    """

    def __init__(self, cell: SignalCell, report: Callable[[str], object]) -> None:
        self._cell = cell
        self._report = report
        self._reported: set[str] = set()

    def share(self, name: str, value: Iterable[float] | float) -> None:
        """Share a value; the next command sends it.

        If an earlier signal was refused, the refusal is reported and this value is not sent.
        """
        try:
            self._cell.signal(name, value, more=True)
        except Refused as error:
            if error.code not in self._reported:
                self._reported.add(error.code)
                self._report(f"some signals are not shared: {error}")
