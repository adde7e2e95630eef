"""What was commanded, and what of it the KRC has taken.

A reply is taken for certain once the next telegram comes and its Delay has not grown. If it has grown, the
KRC has held what it had: after m telegrams that never came here, a growth by m means that the last reply
was still taken, one by m + 1 that it was not. Anything else leaves two possibilities, which differ unless the
robot rests.
"""

from collections.abc import Sequence

from armgate.events import Joints
from armgate.links.rsi.axes import Axis
from armgate.links.rsi.ipoc_and_delay import Follows

_DECIMALS = 6


class SetpointTracker:
    """Setpoint and correction of one run of the KRC's program.

    Args:
        axes: The axes.
        reference: The programmed position that corrections count from, rad or m.
        relative: Whether the KRC adds corrections up.
    """

    def __init__(self, axes: Sequence[Axis], reference: Joints, relative: bool) -> None:
        self._factors = tuple(axis.sent for axis in axes)
        self._relative = relative
        self._rest = (0.0,) * len(reference)
        self.reference = reference
        self.setpoint = self._before = reference
        """The commanded position, rad or m."""
        self._total = self._total_before = self._rest

    @property
    def offset(self) -> Joints:
        """Commanded distance from the reference, rad or m."""
        return tuple([q - origin for q, origin in zip(self.setpoint, self.reference, strict=True)])

    def settle(self, follows: Follows, paused: bool) -> bool:
        """Learn from a telegram which position the KRC holds; it is the setpoint from now on.

        Args:
            follows: How the telegram follows the last one.
            paused: The telegrams stopped for a while: a program that is halted forgets the last reply.

        Returns:
            Whether the position is known.
        """
        if self.setpoint == self._before:
            return True
        forgotten = paused and follows.late == 0
        if follows.late == follows.missed and not forgotten:
            return True
        if follows.late == follows.missed + 1:
            self.setpoint, self._total = self._before, self._total_before
            return True
        return False

    def step(self, increment: Joints | None) -> tuple[float, ...]:
        """Command the next increment, None to rest where the robot is.

        Returns:
            The value of each axis for the reply, in the KRC's units.
        """
        if increment is None:
            self._before, self._total_before = self.setpoint, self._total
            return self._rest if self._relative else self._total
        return self.lead(tuple([q + u for q, u in zip(self.setpoint, increment, strict=True)]))

    def lead(self, setpoint: Joints) -> tuple[float, ...]:
        """Command a position, near the last one; return the values as `step`."""
        self._before, self._total_before = self.setpoint, self._total
        self.setpoint = setpoint
        self._total = tuple(
            [
                round(factor * (q - origin), _DECIMALS) + 0.0  # never -0.0
                for factor, q, origin in zip(self._factors, setpoint, self.reference, strict=True)
            ]
        )
        if not self._relative:
            return self._total
        return tuple([new - old for new, old in zip(self._total, self._total_before, strict=True)])
