"""From a robot's entry in a state to a sample for the core."""

import numpy as np

from armgate.client import Entry, State
from armgate.monitor.frames import Array
from armgate.monitor.motion import Sample

FIELDS = ("q", "setpoint", "stop_end", "stops", "link", "nearest")
"""What of an entry the monitor subscribes to."""


def sample_of(entry: Entry) -> Sample | None:
    """Return the sample of an entry; None if the robot has not ticked yet."""
    if not (entry.q and entry.setpoint and entry.stop_end):
        return None
    nearest = tuple((near.pair[0], near.pair[1], near.distance) for near in entry.nearest or ())
    return Sample(
        entry.robot,
        entry.tick,
        entry.time,
        np.array(entry.q),
        np.array(entry.setpoint),
        np.array(entry.stop_end),
        frozenset(entry.stops or ()),
        entry.link == "ready",
        nearest,
    )


def of_state(state: State) -> tuple[Sample | None, dict[str, Array]]:
    """Return the robot that ticked, and where the stops of the others end now."""
    own: Sample | None = None
    ends = {}
    for entry in state.entries:
        if entry.robot == state.robot:
            own = sample_of(entry)
        elif entry.stop_end:
            ends[entry.robot] = np.array(entry.stop_end)
    return own, ends
