"""What is wrong with what comes in: counted each time, told once."""

from collections import Counter
from collections.abc import Callable


class Diagnostics:
    """Diagnostics of one link.

    Args:
        robot: Its robot's name.
        note: Told each remark once.

    Attributes:
        refused: How many datagrams were refused, by kind.
    """

    def __init__(self, robot: str, note: Callable[[str], None]) -> None:
        self._robot, self._note = robot, note
        self._noted: set[str] = set()
        self.refused: Counter[str] = Counter()

    def tell(self, text: str) -> None:
        """Report an event, each time."""
        self._note(f"{self._robot}: {text}")

    def hint(self, text: str) -> None:
        """Something that somebody should know."""
        self._once(text, text)

    def refuse(self, kind: str, text: str = "") -> None:
        """A datagram was refused; without a text that is nothing to speak of."""
        self.refused[kind] += 1
        if text:
            self._once(kind, text)

    def _once(self, key: str, text: str) -> None:
        if key not in self._noted:
            self._noted.add(key)
            self._note(f"{self._robot}: {text}")
