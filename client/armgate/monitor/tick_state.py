"""State of one robot at one of its ticks, from an entry of a state message."""

from dataclasses import dataclass

import numpy as np

from armgate.client import Entry, State
from armgate.monitor.transforms import Array

FIELDS = ("q", "setpoint", "stop_end", "stops", "link", "nearest")
"""Fields of an entry to which the monitor subscribes."""

_ENDED = ("waiting", "lost", "faulted")


@dataclass(frozen=True, eq=False)
class TickState:
    """State of one robot at one of its ticks; positions in rad or m.

    Attributes:
        ready: True if the link of the robot can move it.
        ended: True if the link is lost, faulted or waiting, so that states may be missing.
    """

    robot: str
    tick: int
    time: float
    q: Array
    setpoint: Array
    stop_end: Array
    stops: frozenset[int] = frozenset()
    ready: bool = True
    nearest: tuple[tuple[str, str, float], ...] = ()
    ended: bool = False


def state_of_entry(entry: Entry) -> TickState | None:
    """Return the state of a robot; None if it has not ticked yet."""
    if not (entry.q and entry.setpoint and entry.stop_end):
        return None
    nearest = tuple((near.pair[0], near.pair[1], near.distance) for near in entry.nearest or ())
    return TickState(
        entry.robot,
        entry.tick,
        entry.time,
        np.array(entry.q),
        np.array(entry.setpoint),
        np.array(entry.stop_end),
        frozenset(entry.stops or ()),
        entry.link == "ready",
        nearest,
        entry.link in _ENDED,
    )


def tick_states(message: State) -> tuple[TickState | None, list[TickState]]:
    """Return the state of the robot that ticked, and those of the others in the message."""
    states = [state for entry in message.entries if (state := state_of_entry(entry)) is not None]
    own = next((state for state in states if state.robot == message.robot), None)
    return own, [state for state in states if state is not own]
