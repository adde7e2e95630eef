"""The states of an RSI link, as a table: what is not in it does not happen."""

from enum import StrEnum


class State(StrEnum):
    """What a link does.

    ``waiting``: no telegram came yet. ``synchronising``: telegrams come and are answered, nothing moves;
    numbers, times and positions have to agree. ``ready``: it takes plans. ``moving``: it plays one. ``lost``:
    telegrams stopped, or the KRC began anew. ``faulted``: what telegrams say cannot be. In the last two
    nothing new is played until an operator re-arms.
    """

    WAITING = "waiting"
    SYNCHRONISING = "synchronising"
    READY = "ready"
    MOVING = "moving"
    LOST = "lost"
    FAULTED = "faulted"


class Event(StrEnum):
    """What can happen to it."""

    HEARD = "heard"
    AGREED = "agreed"
    MOVES = "moves"
    RESTS = "rests"
    HELD = "held"
    GONE = "gone"
    CONTRADICTED = "contradicted"
    REARMED = "rearmed"


ARMED = frozenset({State.SYNCHRONISING, State.READY, State.MOVING})
"""States from which a link can be lost or fault."""

TAKING = frozenset({State.READY, State.MOVING})
"""States in which it takes plans."""

TABLE: dict[tuple[State, Event], State] = {
    (State.WAITING, Event.HEARD): State.SYNCHRONISING,
    (State.WAITING, Event.CONTRADICTED): State.FAULTED,
    (State.SYNCHRONISING, Event.AGREED): State.READY,
    (State.READY, Event.MOVES): State.MOVING,
    (State.MOVING, Event.RESTS): State.READY,
    (State.MOVING, Event.HELD): State.READY,
    **{(state, Event.GONE): State.LOST for state in sorted(ARMED)},
    **{(state, Event.CONTRADICTED): State.FAULTED for state in sorted(ARMED)},
    (State.LOST, Event.REARMED): State.SYNCHRONISING,
    (State.FAULTED, Event.REARMED): State.SYNCHRONISING,
}


def after(state: State, event: Event) -> State | None:
    """The next state; None where the event has no place."""
    return TABLE.get((state, event))
