"""States of a virtual KRC, as a table.

The KRC sends telegrams only in the states of ``ACTIVE``. Events come from the PC (a valid reply), from the
KRC itself (Timeout, AXISCORRMON, a drive, the Stop element), and from the pendant. A pair of state and event
that is not in the table has no effect. From a fault, only the pendant leads back to motion.
"""

from enum import StrEnum


class State(StrEnum):
    """State of the KRC.

    ``stopped``: no program runs. ``waiting``: telegrams are sent, and no reply was received yet. ``running``:
    telegrams are answered. ``paused``: the program is held, and nothing is sent. ``broken_off``: RSI ended by
    itself (Timeout, AXISCORRMON). ``faulted``: a drive reported a fault. ``estopped``: the emergency stop
    was pressed.
    """

    STOPPED = "stopped"
    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    BROKEN_OFF = "broken_off"
    FAULTED = "faulted"
    ESTOPPED = "estopped"


class Event(StrEnum):
    """Event that can change the state."""

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
    # Power is switched off and on again, then the program starts from its beginning.
    **{(state, Event.RESTART): State.WAITING for state in State},
}


def next_state(state: State, event: Event) -> State | None:
    """Return the next state; None if the event has no effect in this state."""
    return TABLE.get((state, event))
