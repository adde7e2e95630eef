"""One run of the KRC's program, from RSI_ON on: what is remembered of it, and what speaks against it."""

from dataclasses import dataclass

from armgate.events import Joints
from armgate.links.rsi.accumulation import AccumulationDetector
from armgate.links.rsi.ipoc_and_delay import Follows, Order, Sequence
from armgate.links.rsi.probe import Probe
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Address, Setup
from armgate.links.rsi.telegram import Telegram

NEW_RUN = 3
"""So many cycles without a telegram there are, at least, between two runs."""

UNKNOWN = "it is not known what the KRC holds: start its program anew"
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
        probe: Proof of the KRC's mode, axes and scales.
        agreed: True once telegrams have agreed with the configuration since the link was armed.
        proven: True once the probe has ended well.
        objection: Reason why nothing moves any more until the program starts anew.
        silent: True if no reply is known to hold the robot: then the KRC is not answered.
        runaway: Compares what is measured with what is commanded.
        adds: True if an absolute KRC was found to add corrections up: it is held by zeros.
        reply: Sent last.
        accepted: Whether the KRC has taken a reply.
        row: Late cycles in a row.
    """

    setup: Setup
    source: Address
    sequence: Sequence
    commanded: SetpointTracker
    q: Joints
    programmed: Joints
    time: float
    probe: Probe
    runaway: AccumulationDetector
    agreed: bool = False
    proven: bool = False
    objection: str | None = None
    silent: bool = False
    adds: bool = False
    reply: bytes | None = None
    accepted: bool = False
    row: int = 0

    def continues(self, telegram: Telegram, follows: Follows, paused: bool, now: float) -> bool | None:
        """Return True if a telegram from the run's own port belongs to it: a new run may use the port again.

        The program of a new run usually holds another position. If it is the same one, because the robot was
        led back to it, the robot is measured there, and not where the old run had commanded it to be. A
        program whose position moves along with the corrections, or is not sent, proves nothing.

        Args:
            telegram: The telegram.
            follows: How it follows the last one.
            paused: There was none for a while.
            now: Time, s.

        Returns:
            True, False, or None if that is unknown.
        """
        commanded, gap = self.commanded, now - self.time > NEW_RUN * self.setup.period
        counted = follows.order is Order.NEXT and follows.late - follows.missed in (0, 1)
        if counted and not follows.missed and not gap:
            return True
        stands = self.programmed == commanded.reference
        if stands and telegram.programmed != self.programmed:
            return False
        if counted and (follows.late or not paused):
            return True
        if commanded.setpoint == commanded.reference:
            return False  # nothing is lost by a new run: its corrections are zeros, too
        here, there = (self._away(telegram.q, one) for one in (commanded.setpoint, commanded.reference))
        if stands and here <= min(there, 1.0):
            return True
        return False if there <= 1.0 and (stands or here > 1.0) else None

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
