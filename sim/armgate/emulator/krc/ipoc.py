"""The telegrams' number: opaque to the PC, which has to echo it."""

from collections import deque

_REMEMBERED = 100


class Ipoc:
    """Counts, wraps, and remembers which numbers were sent.

    Args:
        start: The first number.
        step: From one cycle to the next.
        bits: It wraps after so many.
    """

    def __init__(self, start: int, step: int, bits: int) -> None:
        self._step = step
        self._modulus = 1 << bits
        self._sent: deque[int] = deque(maxlen=_REMEMBERED)
        self.next = start % self._modulus
        """What the next telegram carries."""

    @property
    def last(self) -> int | None:
        """What the last telegram carried; None before the first one."""
        return self._sent[-1] if self._sent else None

    def jump(self, value: int) -> None:
        """Go to any number."""
        self.next = value % self._modulus

    def advance(self) -> None:
        """Go to the next number."""
        self.jump(self.next + self._step)

    def send(self) -> int:
        """The number of a telegram that is now sent."""
        self._sent.append(self.next)
        self.advance()
        return self._sent[-1]

    def age(self, text: str) -> int | None:
        """How many telegrams ago a number was sent, 0 for the last one; None for one that never was."""
        for age, sent in enumerate(reversed(self._sent)):
            if text == str(sent):
                return age
        return None
