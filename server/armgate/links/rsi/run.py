"""One run of the KRC's program, from RSI_ON on: what is remembered of it, and what speaks against it."""

from dataclasses import dataclass

from armgate.cell.events import Joints
from armgate.links.rsi.commanded import Commanded
from armgate.links.rsi.sequence import Follows, Sequence
from armgate.links.rsi.setup import Address, Setup

_UNKNOWN = "what the KRC holds is not known, so it is not answered any more: start its program anew"
_JUMP = 1.5
"""A joint that is measured to move so much faster than it can has jumped."""


@dataclass(slots=True)
class Run:
    """One run.

    Attributes:
        setup: Robot and KRC.
        source: From where its telegrams come.
        sequence: Their numbers.
        commanded: What was commanded in it.
        q: Measured last.
        time: Of the last telegram, s.
        objection: Why it is not answered: what would be held is not known, or not believed.
        accepted: Whether the KRC has taken a reply.
        row: Late cycles in a row.
    """

    setup: Setup
    source: Address
    sequence: Sequence
    commanded: Commanded
    q: Joints
    time: float
    objection: str | None = None
    accepted: bool = False
    row: int = 0

    def settle(self, follows: Follows, paused: bool) -> str | None:
        """Learn from a telegram what the KRC holds, as `Commanded.settle`; why it falls silent, if so."""
        if self.commanded.settle(follows, paused):
            return None
        self.objection = _UNKNOWN
        return _UNKNOWN

    def jumped(self, q: Joints, cycles: int) -> str | None:
        """Which axis is measured to have jumped in so many cycles, if one is."""
        time = _JUMP * cycles * self.setup.period
        rows = zip(self.setup.axes, q, self.q, self.setup.speed, self.setup.tolerance, strict=True)
        for axis, new, old, speed, tolerance in rows:
            if abs(new - old) > speed * time + tolerance:
                far = axis.shown * (new - old)
                return f"the measured {axis.name} jumped by {far:.1f} {axis.unit} in {cycles} cycle(s)"
        return None

    def too_late(self) -> str | None:
        """What to say of cycles that were late too often, if they were."""
        setup, delay = self.setup, self.sequence.delay
        if self.row < setup.late_in_a_row and delay < setup.timeout:
            return None
        if not self.accepted:
            return (
                "the KRC takes none of the replies: does its file have the SENTYPE and the elements of the "
                "one that the cell names, and does it reach this address in time?"
            )
        if delay >= setup.timeout:
            return f"Delay is {delay}, the KRC's Timeout {setup.timeout}: start its program anew"
        return f"{self.row} late cycles in a row"
