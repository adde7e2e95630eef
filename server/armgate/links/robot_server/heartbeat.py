"""Who is to give a sign of life, and who has fallen silent: times in, answers out."""

BEAT = 0.2
"""Time between two signs of life, s."""

SILENCE = 1.0
"""Who is not heard for so long has stalled, s."""


class Liveness:
    """How long the other side has been silent.

    Args:
        now: The time, s, of any clock that does not go back.
        silence: How long it may be silent, s.
    """

    def __init__(self, now: float, silence: float = SILENCE) -> None:
        self._heard = now
        self._looked = now
        self._silence = silence

    def heard(self, now: float) -> None:
        """The other side said something."""
        self._heard = now

    def silent(self, now: float) -> bool:
        """Whether the other side has stalled.

        After a pause of our own it gets its time anew: what it said meanwhile has not been read yet.
        """
        if now - self._looked > self._silence / 2:
            self._heard = max(self._heard, now - self._silence / 2)
        self._looked = now
        return now - self._heard > self._silence
