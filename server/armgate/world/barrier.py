"""Barrier of lock-step: the participants that a step waits for. A state machine without clock or sockets.

A participant is *absent* until its hello; a step waits for it without limit. From then on it is *present*,
and a step waits for it as long as it sends messages. It is *gone* after its bye or when its connection is
closed, and *dropped* when it sent no message for too long: no step waits for it until its next hello.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum

from armgate.protocol import ErrorCode, RemoteProtocolError


class Presence(Enum):
    """Presence of a participant."""

    ABSENT = "absent"
    PRESENT = "present"
    GONE = "gone"
    DROPPED = "dropped"


@dataclass(slots=True)
class _Participant:
    presence: Presence = Presence.ABSENT
    last_message: float = 0.0
    passed: bool = False
    commanded: set[str] = field(default_factory=set)
    done: bool = False


class Barrier:
    """Barrier that decides when a step is complete.

    Args:
        participants: Their names.
        grace: Time for which a present participant may send nothing while a step waits for it, s.
        held_by: Returns the robots that a participant holds, by its name.
    """

    def __init__(
        self, participants: Iterable[str], grace: float, held_by: Callable[[str], frozenset[str]]
    ) -> None:
        self._participants = {name: _Participant() for name in participants}
        self._grace = grace
        self._held_by = held_by
        self._ticked: frozenset[str] = frozenset()
        self._step = -1

    def __contains__(self, name: str) -> bool:
        """Return True if this is the name of a participant."""
        return name in self._participants

    @property
    def step(self) -> int:
        """Number of the current step, -1 before the first."""
        return self._step

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the participants, in their configured order."""
        return tuple(self._participants)

    def presence(self, name: str) -> Presence:
        """Return the presence of a participant."""
        return self._participants[name].presence

    def begin(self, step: int, ticked: Iterable[str], now: float) -> None:
        """Begin a new step, in which these robots have ticked."""
        self._step = step
        self._ticked = frozenset(ticked)
        for participant in self._participants.values():
            participant.passed = participant.done = False
            participant.commanded.clear()
            participant.last_message = now

    def join(self, name: str, now: float) -> None:
        """Register a participant after its hello."""
        self._participants[name] = _Participant(Presence.PRESENT, now)

    def leave(self, name: str) -> None:
        """Stop waiting for a participant after its bye, or after the loss of its connection."""
        if self._participants[name].presence is Presence.PRESENT:
            self._participants[name].presence = Presence.GONE

    def drop(self, name: str) -> None:
        """Stop waiting for a participant that sent nothing for too long."""
        self._participants[name].presence = Presence.DROPPED

    def note_message(self, name: str, now: float) -> None:
        """Note that a participant sent a message."""
        self._participants[name].last_message = now

    def command(self, name: str, robot: str) -> None:
        """Note that a participant commanded a robot in this step."""
        self._participants[name].commanded.add(robot)

    def pass_(self, name: str, step: int) -> None:
        """Note that a participant sends nothing more in this step.

        Raises:
            RemoteProtocolError: ``wrong_step``: it names another step.
        """
        if step != self._step:
            text = f"pass for step {step}; the current one is {self._step}, as in the newest state"
            raise RemoteProtocolError(ErrorCode.WRONG_STEP, text, about="pass")
        self._participants[name].passed = True

    def done(self, name: str) -> bool:
        """Return True if a participant is done with this step.

        It has passed, or has commanded every robot that it holds and that ticked. A participant that holds
        robots of which none ticked is done at once; one that holds no robot must pass. A participant that is
        done stays done until the step ends, even if it loses a lease meanwhile: otherwise its later messages
        would overtake those that wait for the next step.
        """
        participant = self._participants[name]
        if not participant.done:
            held = self._held_by(name)
            commanded = bool(held) and participant.commanded >= held & self._ticked
            participant.done = participant.passed or commanded
        return participant.done

    @property
    def complete(self) -> bool:
        """True if the step may end: there are participants to wait for, and all of them are done."""
        waited = [
            name
            for name, participant in self._participants.items()
            if participant.presence in (Presence.ABSENT, Presence.PRESENT)
        ]
        return bool(waited) and all(
            self.presence(name) is Presence.PRESENT and self.done(name) for name in waited
        )

    def silent(self, now: float) -> list[str]:
        """Return the participants that the step waits for and that sent nothing within the grace."""
        return [
            name
            for name, participant in self._participants.items()
            if participant.presence is Presence.PRESENT
            and not self.done(name)
            and now - participant.last_message >= self._grace
        ]
