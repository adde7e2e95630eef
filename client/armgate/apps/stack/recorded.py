"""States that the observer of a run missed, from the run's recording."""

from pathlib import Path

from armgate.apps.stack.observation import Observation
from armgate.recording import Recording, RecordingError, StateSeries


def completed(seen: Observation, recording: Path, lockstep: bool) -> Observation:
    """Return the observation from a recording unless it lacks more states than an observer missed.

    A slow observer gets the newest state and never a backlog; a recording has every state, with clearances
    rounded down to a micrometre. In lock-step two runs must agree to the last bit, so it is always read.

    Args:
        seen: The states that the observer received.
        recording: Folder of the recording, which has ended.
        lockstep: True if the run was in lock-step; otherwise it is only read if states were missed.
    """
    if not (lockstep or seen.missed):
        return seen
    found = Observation(seen.follower)
    try:
        for state in StateSeries(Recording.open(recording)).all(seen.follower):
            if lockstep or state.time >= seen.first_time:
                found.take(state)
    except RecordingError:
        return seen
    return found if found.rows and found.lacks <= seen.lacks else seen
