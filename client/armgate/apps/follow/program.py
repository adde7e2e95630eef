"""Program of the follower: keep the camera on another robot's tool until its path ends."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.apps.follow.loop import FollowLoop, FollowOptions, FollowOutput
from armgate.client import SignalValue, Tick, Verdict
from armgate.client.program import Outcome, ProgramCell, ProgramContext

Array = NDArray[np.float64]
Values = dict[str, tuple[float, ...]]

AT_REST = 1e-9
"""Increment below which the robot is at rest, rad or m."""


class FollowProgram:
    """Follow until the leader has finished, the duration has passed or an end is requested; a `Program`.

    It fails if the leader disconnects before its path is finished; the robot is then at rest.

    Args:
        loop: State and models of the follower.
        duration: Time for which to follow, s; None: without limit.

    Attributes:
        fields: Fields of the entries that it reads.
        outcome: The outcome, once it has ended.
    """

    fields: Sequence[str] | None = ("q", "setpoint", "stop_end", "nearest", "holder")

    def __init__(self, loop: FollowLoop, duration: float | None = None) -> None:
        self.outcome = Outcome("following")
        self._loop = loop
        self._duration = duration
        self._begin: float | None = None
        self._interrupted = False
        self._ending: str | None = None
        self._progress = Progress()
        self._values: Values = {}
        self._shared: Values = {}

    @classmethod
    def build(
        cls,
        cell: ProgramCell,
        robot: str,
        leader: str,
        options: FollowOptions,
        duration: float | None = None,
    ) -> "FollowProgram":
        """Build the program for a cell.

        Raises:
            UsageError: A robot is unknown, both are the same, or the follower's robot has no camera.
        """
        return cls(FollowLoop.build(cell, robot, leader, options), duration)

    def step(self, tick: Tick) -> Array | None:
        """Return the next increment (n,): towards the wanted view, or braking at the end."""
        self._begin = tick.time if self._begin is None else self._begin
        output = self._loop.step(tick)
        if self._ending is not None and np.all(np.abs(output.played) < AT_REST):
            self.outcome = self._outcome(self._ending)
            return None
        self._values = output.signals()
        if self._ending is None:
            self._ending = self._ended(tick, self._begin)
        return self._increment(output)

    def signals(self) -> Values:
        """Return the follower's errors that have changed."""
        values = changes(self._values, self._shared)
        self._shared |= values
        return values

    def verdict(self, verdict: Verdict) -> None:
        """Ignore the verdict: the next tick shows what was played."""

    def interrupt(self) -> bool:
        """Request the end: the robot brakes to rest first."""
        self._interrupted = True
        return True

    def _increment(self, output: FollowOutput) -> Array:
        return output.step.dq if self._ending is None else self._loop.bounds.braked(output.played)

    def _ended(self, tick: Tick, begin: float) -> str | None:
        """Return the reason to end at this tick; None to continue."""
        if self._interrupted:
            return "interrupted"
        if self._duration is not None and tick.time - begin >= self._duration:
            return "duration has passed"
        return self._progress.ending(*self._loop.leader_progress(tick))

    def _outcome(self, ending: str) -> Outcome:
        if not self._progress.left:
            return Outcome(f"{ending}, at rest")
        share = f"{100 * self._progress.value:.0f} %"
        text = f"{self._loop.robot.name} is at rest: the leader disconnected at {share} of its path"
        return Outcome(text, failed=True)


def make(
    context: ProgramContext,
    *,
    leader: str,
    distance: float = 1.0,
    lag: float = 0.03,
    focus: Sequence[float] | None = None,
    predict: bool = True,
    duration: float | None = None,
) -> FollowProgram:
    """Make the program; the options are those of ``armgate follow``.

    Raises:
        UsageError: A robot is unknown, both are the same, or the follower's robot has no camera.
        BadArgument: No robot was named.
    """
    point = None if focus is None else (float(focus[0]), float(focus[1]), float(focus[2]))
    options = FollowOptions(distance, lag, focus=point, predict=predict)
    return FollowProgram.build(context.cell, context.own, leader, options, duration)


@dataclass
class Progress:
    """Progress of the leader's path.

    Only values shared by the holder of the leader's robot count, and only from 0 to 1: any client may
    have shared a signal of this name before.

    Attributes:
        value: Newest progress, 0 to 1.
        left: True if the leader disconnected before its path was finished.
    """

    value: float = 0.0
    left: bool = False
    _owner: str | None = None

    def ending(self, signal: SignalValue | None, holder: str | None) -> str | None:
        """Return the reason to end; None to continue, also if the leader has never shared its progress.

        Args:
            signal: Signal of the progress.
            holder: Name of the client that holds the leader's robot.
        """
        if signal is not None and signal.owner == holder:
            self._owner = holder
        if self._owner is None:
            return None
        if signal is None or signal.owner != self._owner:
            self.left = True
            return "the leader has disconnected"
        if 0.0 <= signal.value[0] <= 1.0:
            self.value = signal.value[0]
        return "the leader's path is finished" if self.value >= 1.0 else None


def changes(values: Values, shared: Values) -> Values:
    """Return the values that differ from those that were shared before."""
    return {name: value for name, value in values.items() if shared.get(name) != value}
