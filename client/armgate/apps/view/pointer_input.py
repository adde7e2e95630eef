"""What a page wants of the robot that it drives: something only while its pointer is held down."""

from collections.abc import Callable
from time import monotonic

from armgate.apps.lead.inputs.mailbox import Mailbox
from armgate.apps.lead.motions import Array, JointTarget, Motion, MotionRequest, RobotState

FRESH = 0.5
"""How long a beat counts, s: a browser without a GPU is busy for some tenths with one picture."""


class PointerInput:
    """An input of a leader, fed by a page.

    The page says again and again that its pointer is held (``beat``), where to (``pull``), and that it was
    let go (``release``). Let go is rest, at once. A page that hangs or cannot be reached any more beats no
    more: rest, within ``FRESH``.

    Args:
        now: A clock that does not go back, s.
    """

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self._now = now
        self._box = Mailbox(FRESH, now)
        self._beat: float | None = None
        self._motion: Motion | None = None
        self._setpoint: Array | None = None
        self._base: Array | None = None

    # --- what the page says ---------------------------------------------------------------------------------

    def beat(self) -> None:
        """The pointer is held down."""
        self._beat = self._now()
        if self._motion is not None:
            self._box.put(self._motion)

    def pull(self, motion: Motion) -> None:
        """Go there, while the pointer is held; when it is not, this counts for nothing."""
        if self._beat is not None:
            self._motion = motion
            self.beat()

    def pull_joint(self, joint: int, value: float) -> None:
        """Bring one joint there, rad or m; the others stay where they were when it was taken."""
        if self._base is None:
            self._base = self._setpoint
        if self._base is not None:
            q = self._base.copy()
            q[joint] = value
            self.pull(JointTarget(q))

    def release(self) -> None:
        """The pointer was let go."""
        self._beat = self._motion = self._base = None
        self._box.put(None)

    def end(self, why: str) -> None:
        """Drive no more: the robot comes to rest, and the lease goes back."""
        self._box.end(why)

    @property
    def pulling(self) -> bool:
        """Whether a handle is held now; then it shows what is wanted, else where the robot is."""
        beat = self._beat
        return self._motion is not None and beat is not None and self._now() - beat < FRESH

    # --- what the leader asks -------------------------------------------------------------------------------

    def request(self, state: RobotState) -> MotionRequest:
        """What is wanted at this tick."""
        self._setpoint = state.setpoint
        return self._box.request(state)

    def close(self) -> None:
        """Nothing to let go of."""
