"""Diagnostics of a link: counts of rejected datagrams, and notes to the operator without repetitions."""

from collections import Counter
from collections.abc import Callable


class Diagnostics:
    """Diagnostics of one link.

    Args:
        robot: Name of its robot.
        note: Called with each note.

    Attributes:
        rejected: Number of rejected datagrams, by kind.
    """

    def __init__(self, robot: str, note: Callable[[str], None]) -> None:
        self._robot, self._note = robot, note
        self._noted: set[str] = set()
        self.rejected: Counter[str] = Counter()

    def note(self, text: str) -> None:
        """Note an event, every time."""
        self._note(f"{self._robot}: {text}")

    def note_once(self, text: str) -> None:
        """Note a mistake that the operator can correct, once."""
        self._once(text, text)

    def reject(self, kind: str, text: str = "") -> None:
        """Count a rejected datagram; note the text, if there is one, once for this kind."""
        self.rejected[kind] += 1
        if text:
            self._once(kind, text)

    def _once(self, key: str, text: str) -> None:
        if key not in self._noted:
            self._noted.add(key)
            self.note(text)
