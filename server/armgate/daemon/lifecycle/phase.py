"""Phases of a daemon's life, as a table.

A daemon runs until a signal or a defect ends it. In both cases the robots first come to rest. After a signal
the daemon stops the robots. After a defect it no longer uses the gate, and the robots play their plans to
rest.
"""

from enum import Enum


class Phase(Enum):
    """Phase of a daemon's life."""

    RUNNING = "running"
    RESTING = "resting"
    """A signal ended the daemon: all robots are stopped and come to rest."""
    FAILED = "failed"
    """A defect occurred: the gate is no longer used, and the robots play their plans to rest."""
    OVER = "over"


class PhaseEvent(Enum):
    """Event that may change the phase."""

    END = "end"
    """A signal ended the daemon."""
    FAIL = "fail"
    """A defect occurred."""
    REST = "rest"
    """All robots rest, or the time to come to rest has passed."""


TRANSITIONS: dict[tuple[Phase, PhaseEvent], Phase] = {
    (Phase.RUNNING, PhaseEvent.END): Phase.RESTING,
    (Phase.RUNNING, PhaseEvent.FAIL): Phase.FAILED,
    (Phase.RESTING, PhaseEvent.END): Phase.OVER,  # a second signal: end at once
    (Phase.RESTING, PhaseEvent.FAIL): Phase.FAILED,
    (Phase.RESTING, PhaseEvent.REST): Phase.OVER,
    (Phase.FAILED, PhaseEvent.END): Phase.OVER,
    (Phase.FAILED, PhaseEvent.REST): Phase.OVER,
}
"""All transitions: an event without an entry for a phase has no effect."""


class Lifetime:
    """Phase and exit status of a daemon."""

    def __init__(self) -> None:
        self._phase = Phase.RUNNING
        self._status = 0

    @property
    def phase(self) -> Phase:
        """The current phase."""
        return self._phase

    @property
    def status(self) -> int:
        """Exit status: 0, or 1 if something failed."""
        return self._status

    def advance(self, event: PhaseEvent) -> bool:
        """Process an event; return True if it changed the phase."""
        following = TRANSITIONS.get((self._phase, event))
        if following is None:
            return False
        self._phase = following
        return True

    def fail(self) -> None:
        """Make the exit status 1."""
        self._status = 1
