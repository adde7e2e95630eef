"""IPOC and Delay of the KRC's telegrams: their order, missed telegrams and late replies.

An IPOC has no meaning of its own. It grows by a constant step, which is learnt, and may wrap at 32 or 64
bits. Delay is the KRC's count of cycles without a reply in time: if it has grown, the KRC has held the robot.
"""

from dataclasses import dataclass
from enum import StrEnum

_WRAPS = (1 << 32, 1 << 64)
_OLD = 64
"""Largest age of a telegram that arrives out of order, in telegrams."""
_LARGEST_STEP = 1000
_FAR = 10_000
"""Largest number of telegrams that may be missing."""


class Order(StrEnum):
    """Place of a telegram relative to the last one: next, repeated, older, or none of these."""

    NEXT = "next"
    TWICE = "twice"
    OLD = "old"
    JUMP = "jump"


@dataclass(frozen=True, slots=True)
class Succession:
    """Relation of a telegram to the last one.

    Attributes:
        order: Its place.
        missed: Number of telegrams between them that never arrived.
        late: Growth of the KRC's Delay between them.
    """

    order: Order
    missed: int = 0
    late: int = 0


class TelegramCounter:
    """IPOC and Delay in one run of the KRC's program.

    Args:
        ipoc: IPOC of its first telegram.
        delay: Delay in that telegram.

    Attributes:
        ipoc: IPOC of the last telegram.
        delay: Delay in the last telegram.
        step: Difference between successive IPOCs; 0: not known yet.
        learning: True while a smaller step may still be found.
    """

    def __init__(self, ipoc: int, delay: int) -> None:
        self.ipoc, self.delay = ipoc, delay
        self.step = 0
        self.learning = True

    def place(self, ipoc: int, delay: int) -> Succession:
        """Return the relation of a telegram to the last one; the next one becomes the last one."""
        ahead = self._ahead(ipoc)
        if ahead == 0:
            return Succession(Order.TWICE)
        if -_OLD * (self.step or 1) <= ahead < 0:
            return Succession(Order.OLD)
        self._learn(ahead)
        if not 0 < ahead <= _FAR * self.step or ahead % self.step or delay < self.delay:
            return Succession(Order.JUMP)
        succession = Succession(Order.NEXT, ahead // self.step - 1, delay - self.delay)
        self.ipoc, self.delay = ipoc, delay
        return succession

    def _learn(self, ahead: int) -> None:
        """Take the smallest step that was seen: telegrams may be missing between the first ones."""
        if self.learning and 0 < ahead < (self.step or _LARGEST_STEP + 1):
            self.step = ahead

    def _ahead(self, ipoc: int) -> int:
        ahead = ipoc - self.ipoc
        if ahead >= 0:
            return ahead
        limit = _FAR * (self.step or 1)
        wrapped = [ahead + wrap for wrap in _WRAPS if self.ipoc < wrap and 0 < ahead + wrap <= limit]
        return wrapped[0] if wrapped else ahead
