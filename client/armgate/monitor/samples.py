"""From a robot's entry in a state to a sample for the core."""

import numpy as np

from armgate.client import Entry, State
from armgate.monitor.motion import Sample

FIELDS = ("q", "setpoint", "stop_end", "stops", "link", "nearest")
"""What of an entry the monitor subscribes to."""

_ENDED = ("waiting", "lost", "faulted")


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
        entry.link in _ENDED,
    )


def of_state(state: State) -> tuple[Sample | None, list[Sample]]:
    """Return the robot that ticked, and the others as the state shows them."""
    samples = [sample for entry in state.entries if (sample := sample_of(entry)) is not None]
    own = next((sample for sample in samples if sample.robot == state.robot), None)
    return own, [sample for sample in samples if sample is not own]
