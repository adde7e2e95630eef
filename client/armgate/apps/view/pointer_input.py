"""Input of a leader that a page's pointer drives: it requests motion only while the pointer is held down."""

from collections.abc import Callable
from time import monotonic

from armgate.apps.lead.inputs.mailbox import Mailbox
from armgate.apps.lead.motions import Array, JointTarget, Motion, MotionRequest, RobotState

HOLD_TIMEOUT = 0.5
"""Timeout of a hold, s: a browser without a GPU is busy for some tenths of a second with one picture."""


class PointerInput:
    """Input of a leader, driven by one page.

    The page reports repeatedly that its pointer is held down (``hold``), the target (``move_to``), and the
    release of the pointer (``release``). After a release the robot comes to rest at once. If the page hangs
    or cannot be reached, its holds stop, and the robot comes to rest within ``HOLD_TIMEOUT``.

    Args:
        now: Monotonic clock, s.
    """

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self._now = now
        self._box = Mailbox(HOLD_TIMEOUT, now)
        self._held_at: float | None = None
        self._motion: Motion | None = None
        self._setpoint: Array | None = None
        self._base: Array | None = None

    # --- called by the page ---------------------------------------------------------------------------------

    def hold(self) -> None:
        """Report that the pointer is held down."""
        self._held_at = self._now()
        if self._motion is not None:
            self._box.put(self._motion)

    def move_to(self, motion: Motion) -> None:
        """Request a motion while the pointer is held down; without effect otherwise."""
        if self._held_at is not None:
            self._motion = motion
            self.hold()

    def move_joint(self, joint: int, value: float) -> None:
        """Move one joint to a position, rad or m; the others stay where they were when the motion began."""
        if self._base is None:
            self._base = self._setpoint
        if self._base is not None:
            q = self._base.copy()
            q[joint] = value
            self.move_to(JointTarget(q))

    def release(self) -> None:
        """Report that the pointer was released."""
        self._held_at = self._motion = self._base = None
        self._box.put(None)

    def end(self, why: str) -> None:
        """End driving: the robot comes to rest, and the lease is released."""
        self._box.end(why)

    @property
    def moving(self) -> bool:
        """Return True if a handle is held; then it shows the target, otherwise the robot's position."""
        held_at = self._held_at
        return self._motion is not None and held_at is not None and self._now() - held_at < HOLD_TIMEOUT

    # --- called by the leader's loop ------------------------------------------------------------------------

    def request(self, state: RobotState) -> MotionRequest:
        """Return the motion that is requested at this tick."""
        self._setpoint = state.setpoint
        return self._box.request(state)

    def close(self) -> None:
        """Do nothing: there is no device to close."""
