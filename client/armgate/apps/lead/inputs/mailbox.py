"""Wishes that somebody else puts: a page, another thread."""

from collections.abc import Callable
from threading import Lock
from time import monotonic

from armgate.apps.lead.motions import Motion, MotionRequest, RobotState

FRESH = 0.3
"""For how long a motion is wanted after it was put, s: who holds a switch says so again and again."""


class Mailbox:
    """Holds the newest wish. One that was not renewed counts no more: a page that hangs lets the robot rest.

    Args:
        fresh: How long a motion counts, s.
        now: A clock that does not go back, s.
    """

    def __init__(self, fresh: float = FRESH, now: Callable[[], float] = monotonic) -> None:
        self._fresh = fresh
        self._now = now
        self._lock = Lock()
        self._wish = MotionRequest()
        self._until = now()

    def put(self, motion: Motion | None) -> None:
        """Want this from now on, for a short time; None: rest. Any thread may call it."""
        with self._lock:
            if not self._wish.ended:
                self._wish, self._until = MotionRequest(motion), self._now() + self._fresh

    def end(self, why: str, failed: bool = False) -> None:
        """Want nothing any more; the robot comes to rest and the loop ends."""
        with self._lock:
            self._wish = MotionRequest(ended=why, failed=failed)

    def request(self, state: RobotState) -> MotionRequest:
        """The newest wish, while it counts."""
        with self._lock:
            return self._wish if self._wish.ended or self._now() < self._until else MotionRequest()

    def close(self) -> None:
        """Nothing to let go of."""
