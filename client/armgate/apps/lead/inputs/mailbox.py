"""Input whose motions come from another thread, such as that of a web page."""

from collections.abc import Callable
from threading import Lock
from time import monotonic

from armgate.apps.lead.motions import Motion, MotionRequest, RobotState

VALIDITY = 0.3
"""Time for which a motion is valid, s: the sender must renew it while its deadman switch is held."""


class Mailbox:
    """Newest requested motion; it expires unless it is renewed, so the robot comes to rest if the page hangs.

    Args:
        validity: Validity of a motion, s.
        now: Monotonic clock, s.
    """

    def __init__(self, validity: float = VALIDITY, now: Callable[[], float] = monotonic) -> None:
        self._validity = validity
        self._now = now
        self._lock = Lock()
        self._newest = MotionRequest()
        self._until = now()

    def put(self, motion: Motion | None) -> None:
        """Request a motion for a short time; None to rest. May be called from any thread."""
        with self._lock:
            if not self._newest.ended:
                self._newest, self._until = MotionRequest(motion), self._now() + self._validity

    def end(self, why: str, failed: bool = False) -> None:
        """End the input: the robot comes to rest and the loop ends."""
        with self._lock:
            self._newest = MotionRequest(ended=why, failed=failed)

    def request(self, state: RobotState) -> MotionRequest:
        """Return the newest requested motion if it is still valid."""
        with self._lock:
            return self._newest if self._newest.ended or self._now() < self._until else MotionRequest()

    def close(self) -> None:
        """Do nothing: there is no device to close."""
