"""Setpoint of an RSI link: the commanded position, and the part of it that the KRC has taken.

A reply counts as taken once the next telegram comes and its Delay has not grown. If the Delay has grown, the
KRC has held its last value. After m telegrams that were lost on their way here, a growth by m means that the
last reply was still taken, and a growth by m + 1 that it was not. Any other growth leaves both possible; they
differ unless the robot rests.
"""

from collections.abc import Sequence

from armgate.events import Joints
from armgate.links.rsi.axes import Axis
from armgate.links.rsi.ipoc_and_delay import Succession

_DECIMALS = 6


class SetpointTracker:
    """Setpoint and correction of one run of the KRC's program.

    Args:
        axes: The axes.
        reference: Programmed position from which corrections count, rad or m.
        relative: True if the KRC adds corrections up.

    Attributes:
        reference: Position from which corrections count, rad or m.
        setpoint: Commanded position, rad or m.
    """

    def __init__(self, axes: Sequence[Axis], reference: Joints, relative: bool) -> None:
        self._factors = tuple(axis.sent for axis in axes)
        self._relative = relative
        self._rest = (0.0,) * len(reference)
        self.reference = reference
        self.setpoint = self._before = reference
        self._total = self._total_before = self._rest

    @property
    def offset(self) -> Joints:
        """Commanded distance from the reference, rad or m."""
        return tuple([q - origin for q, origin in zip(self.setpoint, self.reference, strict=True)])

    def settle(self, succession: Succession, paused: bool) -> bool:
        """Conclude from a telegram which position the KRC holds; it is the setpoint from now on.

        Args:
            succession: Relation of the telegram to the last one.
            paused: True if telegrams stopped for a while: a program that was halted drops the last reply.

        Returns:
            True if the position is known.
        """
        if self.setpoint == self._before:
            return True
        forgotten = paused and succession.late == 0
        if succession.late == succession.missed and not forgotten:
            return True
        if succession.late == succession.missed + 1:
            self.setpoint, self._total = self._before, self._total_before
            return True
        return False

    def step(self, increment: Joints | None) -> tuple[float, ...]:
        """Command the next increment; None holds the robot at its position.

        Returns:
            The value of each axis for the reply, in the KRC's units.
        """
        if increment is None:
            self._before, self._total_before = self.setpoint, self._total
            return self._rest if self._relative else self._total
        return self.go_to(tuple([q + u for q, u in zip(self.setpoint, increment, strict=True)]))

    def go_to(self, setpoint: Joints) -> tuple[float, ...]:
        """Command a position near the last one; return the values for the reply, as `step` does."""
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
