"""Player of plans: the part of a link that decides which increment the robot takes at a tick.

A plan replaces the held one by compare-and-swap and takes effect at exactly one tick. If a plan is lost or
too late, the held plan runs out, and every plan ends at rest.
"""

from collections import OrderedDict
from dataclasses import dataclass

from armgate.events import Joints, Plan, PlanAnswer, PlanKey, Rebase

_REMEMBERED = 64
"""Number of answers kept for plans that are sent again; a repetition is never older than a few ticks."""


@dataclass(frozen=True, slots=True)
class Played:
    """Increment that was played at a tick (None at rest), its plan, and its index in the plan."""

    increment: Joints | None = None
    key: PlanKey | None = None
    index: int = -1


class PlanPlayer:
    """Player of the plans of one robot, which also counts its ticks.

    Args:
        robot: Name of the robot.
        start: Start id that plans carry; a plan of another start is refused.
    """

    def __init__(self, robot: str, start: str) -> None:
        self._name = robot
        self._start = start
        self._resets = 0
        self._tick = -1
        self._held: Plan | None = None
        self._next: Plan | None = None
        self._last = Played()
        self._answers: OrderedDict[Plan, PlanAnswer] = OrderedDict()

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._name

    @property
    def tick(self) -> int:
        """Number of the last tick, -1 before the first."""
        return self._tick

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes."""
        if self._next is not None:
            return len(self._next.increments)
        return 0 if self._held is None else len(self._held.increments) - 1 - self._last.index

    def offer(self, plan: Plan) -> PlanAnswer:
        """Accept ``plan`` for the next tick if it was made for the increment that is played now.

        Returns:
            Accepted, or the reason. ``mismatch``: another daemon start, reset count or last increment played,
            or the tick is already taken by another plan. ``late``: its tick has passed. ``early``: its tick
            is not the next one. A repeated plan gets the same answer and changes nothing.
        """
        known = self._answers.get(plan)
        if known is not None:
            return known
        reason = self._objection(plan.key)
        if not reason:
            self._next = plan
        return self._remember(plan, PlanAnswer(self._name, plan.key, not reason, reason))

    def play(self) -> Played:
        """Go to the next tick and play its increment, if the plan has not run out."""
        self._tick += 1
        if self._next is not None:
            self._held, self._next, index = self._next, None, 0
        else:
            index = self._last.index + 1
        if self._held is None or index >= len(self._held.increments):
            self._held, self._last = None, Played()
        else:
            self._last = Played(self._held.increments[index], self._held.key, index)
        return self._last

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and the next one; plans made before are refused from now on."""
        self._resets = rebase.resets
        self.drop()

    def drop(self) -> None:
        """Drop the plan and the next one: the robot has been held in place, and rests."""
        self._held = self._next = None
        self._last = Played()

    def _objection(self, key: PlanKey) -> str:
        if key.start != self._start or key.resets != self._resets:
            return "mismatch"
        if key.target <= self._tick:
            return "late"
        if key.target > self._tick + 1:
            return "early"
        if key.last_played != self._last.index or self._next is not None:
            return "mismatch"
        return ""

    def _remember(self, plan: Plan, answer: PlanAnswer) -> PlanAnswer:
        self._answers[plan] = answer
        if len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
        return answer
