"""The states of a virtual KRC, as a table: what is not in it does not happen."""

from enum import StrEnum


class State(StrEnum):
    """What the KRC does.

    ``stopped``: no program runs. ``waiting``: telegrams are sent, none was answered yet. ``running``: they
    are answered. ``paused``: the program is held, nothing is sent. ``broken_off``: RSI gave up by itself
    (Timeout, AXISCORRMON). ``faulted``: a drive gave up. ``estopped``: somebody pressed the button.
    """

    STOPPED = "stopped"
    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    BROKEN_OFF = "broken_off"
    FAULTED = "faulted"
    ESTOPPED = "estopped"


class Event(StrEnum):
    """What can happen to it: from within, from the PC, from whoever stands at the pendant."""

    ANSWERED = "answered"
    TIMEOUT = "timeout"
    MONITOR = "monitor"
    DRIVE = "drive"
    SENSOR_STOP = "sensor_stop"
    START = "start"
    STOP = "stop"
    PAUSE = "pause"
    RESUME = "resume"
    ESTOP = "estop"
    RESET = "reset"
    RESTART = "restart"


ACTIVE = frozenset({State.WAITING, State.RUNNING})
"""States in which telegrams are sent."""

TABLE: dict[tuple[State, Event], State] = {
    (State.STOPPED, Event.START): State.WAITING,
    (State.WAITING, Event.ANSWERED): State.RUNNING,
    (State.RUNNING, Event.ANSWERED): State.RUNNING,
    (State.PAUSED, Event.RESUME): State.WAITING,
    (State.PAUSED, Event.STOP): State.STOPPED,
    (State.BROKEN_OFF, Event.RESET): State.STOPPED,
    (State.FAULTED, Event.RESET): State.STOPPED,
    (State.ESTOPPED, Event.RESET): State.STOPPED,
    **{(state, Event.TIMEOUT): State.BROKEN_OFF for state in ACTIVE},
    **{(state, Event.MONITOR): State.BROKEN_OFF for state in ACTIVE},
    **{(state, Event.DRIVE): State.FAULTED for state in ACTIVE},
    **{(state, Event.SENSOR_STOP): State.STOPPED for state in ACTIVE},
    **{(state, Event.STOP): State.STOPPED for state in ACTIVE},
    **{(state, Event.PAUSE): State.PAUSED for state in ACTIVE},
    **{(state, Event.ESTOP): State.ESTOPPED for state in State},
    # Power off and on again, and the program from its beginning.
    **{(state, Event.RESTART): State.WAITING for state in State},
}


def after(state: State, event: Event) -> State | None:
    """The next state; None where the event has no place."""
    return TABLE.get((state, event))
