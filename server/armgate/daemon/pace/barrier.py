"""Who is waited for in lock-step: a pure machine, without clock or sockets.

A participant is *absent* until it says hello, and waited for without limit; *present* from then on, and
waited for as long as it gives signs of life; *gone* when it said bye or its connection closed, and *dropped*
when it was silent for too long: neither is waited for until it comes again.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum

from armgate.protocol import ErrorCode, RemoteProtocolError


class Presence(Enum):
    """Where a participant is."""

    ABSENT = "absent"
    PRESENT = "present"
    GONE = "gone"
    DROPPED = "dropped"


@dataclass(slots=True)
class _Participant:
    presence: Presence = Presence.ABSENT
    heard: float = 0.0
    passed: bool = False
    commanded: set[str] = field(default_factory=set)
    done: bool = False


class Barrier:
    """Tells when a step is complete.

    Args:
        participants: Their names.
        grace: How long a present one may be silent while it is waited for, s.
        held_by: The robots that a participant holds, by its name.
    """

    def __init__(self, participants: Iterable[str], grace: float, held_by: Callable[[str], set[str]]) -> None:
        self._participants = {name: _Participant() for name in participants}
        self._grace = grace
        self._held_by = held_by
        self._ticked: frozenset[str] = frozenset()
        self.step = -1

    def __contains__(self, name: str) -> bool:
        """Whether this is the name of a participant."""
        return name in self._participants

    @property
    def names(self) -> tuple[str, ...]:
        """The participants, in their configured order."""
        return tuple(self._participants)

    def presence(self, name: str) -> Presence:
        """Where a participant is."""
        return self._participants[name].presence

    def begin(self, step: int, ticked: Iterable[str], now: float) -> None:
        """A new step: these robots ticked in it."""
        self.step = step
        self._ticked = frozenset(ticked)
        for participant in self._participants.values():
            participant.passed = participant.done = False
            participant.commanded.clear()
            participant.heard = now

    def join(self, name: str, now: float) -> None:
        """A participant said hello."""
        self._participants[name] = _Participant(Presence.PRESENT, now)

    def leave(self, name: str) -> None:
        """A participant said bye, or its connection is gone."""
        if self._participants[name].presence is Presence.PRESENT:
            self._participants[name].presence = Presence.GONE

    def drop(self, name: str) -> None:
        """A participant is not waited for any longer."""
        self._participants[name].presence = Presence.DROPPED

    def heard(self, name: str, now: float) -> None:
        """A participant gave a sign of life."""
        self._participants[name].heard = now

    def command(self, name: str, robot: str) -> None:
        """A participant commanded a robot in this step."""
        self._participants[name].commanded.add(robot)

    def pass_(self, name: str, step: int) -> None:
        """A participant has nothing more for this step.

        Raises:
            RemoteProtocolError: ``wrong_step``: it names another one.
        """
        if step != self.step:
            text = f"pass for step {step}; the current one is {self.step}"
            raise RemoteProtocolError(ErrorCode.WRONG_STEP, text, about="pass")
        self._participants[name].passed = True

    def done(self, name: str) -> bool:
        """Whether a participant has said all that it has to in this step.

        It has passed, or commanded every robot that it holds and that ticked. Who holds robots of which none
        ticked has nothing to say; who holds none must pass. A participant that is done stays so until the
        step ends, also if it loses a lease meanwhile: else its later messages would overtake those that wait
        for the next step.
        """
        participant = self._participants[name]
        if not participant.done:
            held = self._held_by(name)
            commanded = bool(held) and participant.commanded >= held & self._ticked
            participant.done = participant.passed or commanded
        return participant.done

    @property
    def complete(self) -> bool:
        """Whether the step may end: somebody takes part, and nobody is still waited for."""
        waited = [
            name
            for name, participant in self._participants.items()
            if participant.presence in (Presence.ABSENT, Presence.PRESENT)
        ]
        return bool(waited) and all(
            self.presence(name) is Presence.PRESENT and self.done(name) for name in waited
        )

    def silent(self, now: float) -> list[str]:
        """The participants that are waited for and gave no sign of life within the grace."""
        return [
            name
            for name, participant in self._participants.items()
            if participant.presence is Presence.PRESENT
            and not self.done(name)
            and now - participant.heard >= self._grace
        ]
