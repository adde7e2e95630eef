"""One run of the KRC's program, as its telegrams' numbers tell it: what follows what, and what was missed.

An IPOC means nothing by itself; it grows by a constant step, which is learnt, and may wrap at 32 or 64 bits.
"""

from dataclasses import dataclass
from enum import StrEnum

_WRAPS = (1 << 32, 1 << 64)
_OLD = 64
"""So many telegrams ago a datagram may have been sent that now comes late, out of order."""
_LARGEST_STEP = 1000
_FAR = 10_000
"""So many telegrams may be missing."""


class Order(StrEnum):
    """How a telegram stands to the last one."""

    NEXT = "next"
    TWICE = "twice"
    OLD = "old"
    JUMP = "jump"


@dataclass(frozen=True, slots=True)
class Follows:
    """How a telegram stands to the last one.

    Attributes:
        order: In kind.
        missed: How many telegrams between them never came.
        late: By how much the KRC's Delay grew.
    """

    order: Order
    missed: int = 0
    late: int = 0


class Sequence:
    """The numbers of one run.

    Args:
        ipoc: Of its first telegram.
        delay: There.
    """

    def __init__(self, ipoc: int, delay: int) -> None:
        self.ipoc, self.delay = ipoc, delay
        self.step = 0
        """From one IPOC to the next; 0: not known yet."""
        self.learning = True
        """Whether a smaller step may still be found."""

    def place(self, ipoc: int, delay: int) -> Follows:
        """How a telegram stands to the last one; it becomes the last one if it comes next."""
        ahead = self._ahead(ipoc)
        if ahead == 0:
            return Follows(Order.TWICE)
        if -_OLD * (self.step or 1) <= ahead < 0:
            return Follows(Order.OLD)
        self._learn(ahead)
        if not 0 < ahead <= _FAR * self.step or ahead % self.step or delay < self.delay:
            return Follows(Order.JUMP)
        follows = Follows(Order.NEXT, ahead // self.step - 1, delay - self.delay)
        self.ipoc, self.delay = ipoc, delay
        return follows

    def _learn(self, ahead: int) -> None:
        """Take the smallest step that was seen: there may have been gaps between the first telegrams."""
        if self.learning and 0 < ahead < (self.step or _LARGEST_STEP + 1):
            self.step = ahead

    def _ahead(self, ipoc: int) -> int:
        ahead = ipoc - self.ipoc
        if ahead >= 0:
            return ahead
        limit = _FAR * (self.step or 1)
        wrapped = [ahead + wrap for wrap in _WRAPS if self.ipoc < wrap and 0 < ahead + wrap <= limit]
        return wrapped[0] if wrapped else ahead
