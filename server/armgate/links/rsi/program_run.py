"""One run of the KRC's program, from RSI_ON: its state, and the limits within which it may continue."""

from dataclasses import dataclass

from armgate.events import Joints
from armgate.links.rsi.ipoc_and_delay import Order, Succession, TelegramCounter
from armgate.links.rsi.probe import Probe
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Address, Setup
from armgate.links.rsi.telegram import Telegram
from armgate.links.rsi.wrong_mode_detection import AccumulationDetector

NEW_RUN = 3
"""Smallest number of cycles without a telegram between two runs."""

UNKNOWN = "the position that the KRC holds is not known: start its program anew"
_JUMP = 1.5
"""Measured speed, in top speeds of a joint, above which its position has jumped."""


@dataclass(slots=True)
class Run:
    """One run of the KRC's program.

    Attributes:
        setup: Robot and KRC.
        source: Address and port from which its telegrams come.
        counter: IPOC and Delay of its telegrams.
        commanded: Setpoint of the run.
        q: Position measured last, rad or m.
        programmed: Programmed position in the last telegram, rad or m.
        time: Time of the last telegram, s.
        probe: Probe of the KRC's mode, axes and scales.
        accumulation: Detection of corrections that are added up.
        rebased: True if the next tick breaks the sequence of setpoints: plans are dropped before it.
        agreed: True once telegrams have agreed with the configuration since the link was armed.
        proven: True once the probe has succeeded.
        objection: Reason why nothing moves any more until the program starts anew.
        silent: True if no reply is known to hold the robot: then the KRC is not answered.
        adds: True if an absolute KRC was found to add corrections up: it is answered with zeros.
        reply: Last reply.
        accepted: True once the KRC has taken a reply.
        late_in_a_row: Number of successive late cycles.
        resting_since: Time since which the robot rests, s.
    """

    setup: Setup
    source: Address
    counter: TelegramCounter
    commanded: SetpointTracker
    q: Joints
    programmed: Joints
    time: float
    probe: Probe
    accumulation: AccumulationDetector
    rebased: bool = False
    agreed: bool = False
    proven: bool = False
    objection: str | None = None
    silent: bool = False
    adds: bool = False
    reply: bytes | None = None
    accepted: bool = False
    late_in_a_row: int = 0
    resting_since: float = 0.0

    @classmethod
    def begun(cls, setup: Setup, telegram: Telegram, source: Address, now: float) -> "Run":
        """Return the run that a telegram begins."""
        reference = telegram.programmed if setup.programmed else telegram.q
        return cls(
            setup=setup,
            source=source[:2],
            counter=TelegramCounter(telegram.ipoc, telegram.delay),
            commanded=SetpointTracker(setup.axes, reference, setup.relative),
            q=telegram.q,
            programmed=telegram.programmed,
            time=now,
            probe=Probe(setup),
            accumulation=AccumulationDetector(setup.tolerance, setup.speed, setup.period),
        )

    def continues(self, telegram: Telegram, succession: Succession, paused: bool, now: float) -> bool | None:
        """Return True if a telegram from the run's own port belongs to it: a new run may use the same port.

        The program of a new run usually holds another position. It may hold the same position if the robot
        was moved back to it; then the robot is measured there, and not where the old run had commanded it to
        be. A programmed position that moves along with the corrections, or is not sent, proves nothing.

        Args:
            telegram: The telegram.
            succession: Its relation to the last one.
            paused: True if telegrams stopped for a while.
            now: Time, s.

        Returns:
            True, False, or None if that is unknown.
        """
        commanded, gap = self.commanded, now - self.time > NEW_RUN * self.setup.period
        counted = succession.order is Order.NEXT and succession.late - succession.missed in (0, 1)
        if counted and not succession.missed and not gap:
            return True
        stands = self.programmed == commanded.reference
        if stands and telegram.programmed != self.programmed:
            return False
        if counted and (succession.late or not paused):
            return True
        if commanded.setpoint == commanded.reference:
            return False  # a new run loses nothing: its corrections are zeros, too
        here, there = (self._away(telegram.q, place) for place in (commanded.setpoint, commanded.reference))
        if stands and here <= min(there, 1.0):
            return True
        return False if there <= 1.0 and (stands or here > 1.0) else None

    def jumped(self, q: Joints, cycles: int) -> str | None:
        """Return a text about an axis whose measured position jumped within these cycles, else None."""
        time = _JUMP * cycles * self.setup.period
        rows = zip(self.setup.axes, q, self.q, self.setup.speed, self.setup.tolerance, strict=True)
        for axis, new, old, speed, tolerance in rows:
            if abs(new - old) > speed * time + tolerance:
                far = axis.shown * (new - old)
                return f"the measured {axis.name} jumped by {far:.1f} {axis.unit} in {cycles} cycle(s)"
        return None

    def too_late(self) -> str | None:
        """Return the objection if Delay or the number of late cycles in a row is at its limit, else None."""
        setup, delay = self.setup, self.counter.delay
        if self.late_in_a_row < setup.late_in_a_row and delay < setup.timeout:
            return None
        if not self.accepted:
            return (
                "the KRC takes no replies: check that its file has the SENTYPE and the elements of the file "
                "in the cell, and that replies reach the KRC in time"
            )
        if delay >= setup.timeout:
            return f"Delay is {delay}, the KRC's Timeout {setup.timeout}: start its program anew"
        return f"{self.late_in_a_row} late cycles in a row"

    def _away(self, q: Joints, place: Joints) -> float:
        """Return the distance of a measured position from a place, in tolerances."""
        return max(abs(a - b) / far for a, b, far in zip(q, place, self.setup.tolerance, strict=True))
