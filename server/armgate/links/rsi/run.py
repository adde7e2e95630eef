"""One run of the KRC's program, from RSI_ON on: what is remembered of it, and what speaks against it."""

from dataclasses import dataclass

from armgate.cell.events import Joints
from armgate.links.rsi.commanded import Commanded
from armgate.links.rsi.sequence import Follows, Order, Sequence
from armgate.links.rsi.setup import Address, Setup
from armgate.links.rsi.telegram import Telegram

NEW_RUN = 3
"""So many cycles without a telegram there are, at least, between two runs."""

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
        programmed: As the last telegram has it.
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
    programmed: Joints
    time: float
    objection: str | None = None
    accepted: bool = False
    row: int = 0

    def continues(self, telegram: Telegram, follows: Follows, paused: bool, now: float) -> bool | None:
        """Whether a telegram from the run's own port belongs to it: a new run may use the port again.

        A new run's program holds another position. Where that is the same, as the robot was led back to it,
        the robot is measured there, and not where the old run had commanded it to be.

        Args:
            telegram: The telegram.
            follows: How it follows the last one.
            paused: There was none for a while.
            now: Time, s.

        Returns:
            None where that cannot be told.
        """
        commanded, gap = self.commanded, now - self.time > NEW_RUN * self.setup.period
        counted = follows.order is Order.NEXT and follows.late - follows.missed in (0, 1)
        if counted and not follows.missed and not gap:
            return True
        # A simulator whose programmed position moves along says nothing by it.
        if telegram.programmed != self.programmed == commanded.reference:
            return False
        if counted and (follows.late or not paused):
            return True
        here, there = (self._away(telegram.q, one) for one in (commanded.setpoint, commanded.reference))
        if here <= min(there, 1.0):
            return True
        return False if there <= 1.0 else None

    def doubt(self) -> str:
        """It is not answered any more; why."""
        self.objection = _UNKNOWN
        return _UNKNOWN

    def settle(self, follows: Follows, paused: bool) -> str | None:
        """Learn from a telegram what the KRC holds, as `Commanded.settle`; why it falls silent, if so."""
        if self.commanded.settle(follows, paused):
            return None
        return self.doubt()

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

    def _away(self, q: Joints, place: Joints) -> float:
        """How far a measured position is from a place, in tolerances."""
        return max(abs(a - b) / far for a, b, far in zip(q, place, self.setup.tolerance, strict=True))
