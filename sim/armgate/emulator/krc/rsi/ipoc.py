"""IPOC: the number of a telegram, which the PC echoes unchanged."""

from collections import deque

_REMEMBERED = 100


class Ipoc:
    """Counter that wraps and remembers the numbers that were sent.

    Args:
        start: First number.
        step: Increment from one cycle to the next.
        bits: Number of bits after which it wraps.
    """

    def __init__(self, start: int, step: int, bits: int) -> None:
        self._step = step
        self._modulus = 1 << bits
        self._sent: deque[int] = deque(maxlen=_REMEMBERED)
        self.next = start % self._modulus
        """Number of the next telegram."""

    @property
    def last(self) -> int | None:
        """Number of the last telegram; None before the first one."""
        return self._sent[-1] if self._sent else None

    def jump(self, value: int) -> None:
        """Set the next number to any value."""
        self.next = value % self._modulus

    def advance(self) -> None:
        """Advance to the next number."""
        self.jump(self.next + self._step)

    def send(self) -> int:
        """Return the number of the telegram that is sent now."""
        self._sent.append(self.next)
        self.advance()
        return self._sent[-1]

    def age(self, text: str) -> int | None:
        """Return the number of telegrams since this IPOC, 0 for the last one; None if it was never sent."""
        for age, sent in enumerate(reversed(self._sent)):
            if text == str(sent):
                return age
        return None
