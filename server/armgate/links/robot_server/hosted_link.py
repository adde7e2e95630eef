"""A link as one daemon after the other sees it.

A link outlives daemons. To each it looks new: its ticks count on from where the daemon stands, its keys carry
the daemon's start and its count of resets. What was left playing by the daemon before is played to the end
first; until the robot rests, the next one is told of no tick. And nothing is armed by itself but for the very
first daemon: any other one has to rebase the link, which its operator does by a reset.
"""

from collections.abc import Callable
from dataclasses import replace

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.link import LinkEvent, SelfClockedLink
from armgate.links.robot_server.messages import Played, Standing

Say = Callable[[Played | LinkChange | PlanAnswer], None]
"""Takes what the present daemon is told."""

_STILL = 1e-6
"""A robot that moves less in a tick rests, rad or m."""

_UNARMED = "the robot server had another connection to a daemon before: reset the stop to arm its robots anew"
_ENDING = "the robot server is ending"


class HostedLink:
    """One robot's link, and the daemon that holds it.

    Args:
        link: The link; its plans carry ``start``.
        start: The robot server's start id.
        tolerance: Rounding of the measured q, rad or m.
        settling: How long a robot follows setpoints of the past, s: its declared lag window.
    """

    def __init__(self, link: SelfClockedLink, start: str, tolerance: float, settling: float) -> None:
        self._link = link
        self._start = start
        self._noise = max(2.0 * tolerance, _STILL)  # two measurements of a robot that stands differ by that
        self._settling = settling
        self._change = LinkChange(link.robot, LinkState.WAITING, "the robot has not spoken yet")
        self._resets = 0
        self._last: Tick | None = None
        self._still_since: float | None = None
        self._say: Say | None = None
        self._daemon = ""
        self._had_one = self._armed = self._told = self._first = False
        self._next = self._offset = self._own_resets = 0

    @property
    def robot(self) -> str:
        """The robot's name."""
        return self._link.robot

    @property
    def resting(self) -> bool:
        """Whether the robot has nothing left to play."""
        return not self._link.remaining

    async def open(self) -> None:
        """Start the link."""
        await self._link.open(self._hear)

    def close(self) -> None:
        """End the link."""
        self._link.close()

    # --- daemons ------------------------------------------------------------------------------------------

    def take(self, start: str, standing: Standing, say: Say) -> None:
        """A daemon holds the robot now."""
        self._daemon, self._say = start, say
        self._armed, self._had_one = not self._had_one, True
        self._told, self._first = False, standing.tick > 0
        self._next, self._own_resets = standing.tick, standing.resets
        self._tell_state()

    def leave(self) -> None:
        """The daemon is gone: the plan runs out, and no other one comes from it."""
        self._say, self._armed = None, False

    def disarm(self) -> None:
        """Take no plan any more."""
        self._armed = False
        self._change = LinkChange(self.robot, LinkState.LOST, _ENDING)
        self._tell_state()

    def offer(self, plan: Plan) -> None:
        """The daemon's plan: the answer is said."""
        if not self._armed or not self._told:
            answer = PlanAnswer(self.robot, plan.key, False, "inactive")
        elif plan.key.start != self._daemon or plan.key.resets != self._own_resets:
            answer = PlanAnswer(self.robot, plan.key, False, "mismatch")
        else:
            answer = replace(self._link.offer(replace(plan, key=self._inward(plan.key))), key=plan.key)
        self._tell(answer)

    def rebase(self, rebase: Rebase) -> None:
        """The daemon's operator has reset the robot: arm it, at rest where it stands.

        A reset at a robot that still plays is none: the gate knows that before.
        """
        if not self.resting:
            return
        self._resets += 1
        self._own_resets, self._armed = rebase.resets, True
        self._link.rebase(replace(rebase, resets=self._resets))
        if self._change.state is LinkState.READY:  # one that was lost says so itself, once it is ready
            self._tell_state()

    # --- the robot ----------------------------------------------------------------------------------------

    def _hear(self, event: LinkEvent) -> None:
        if isinstance(event, Tick):
            self._note(event)
            self._tell_tick(event)
        else:
            self._change = event
            self._tell_state()

    def _note(self, tick: Tick) -> None:
        before, self._last = self._last, tick
        moved = 0.0 if before is None else max(abs(a - b) for a, b in zip(tick.q, before.q, strict=True))
        if self._link.remaining or any(tick.increment) or moved > self._noise:
            self._still_since = None
        elif self._still_since is None:
            self._still_since = tick.time

    def _tell_tick(self, tick: Tick) -> None:
        if self._say is None:
            return
        if not self._told:
            if self._still_since is None or tick.time - self._still_since < self._settling:
                return
            self._told, self._offset = True, tick.tick - self._next
        told = replace(
            tick,
            tick=tick.tick - self._offset,
            plan=None if tick.plan is None else self._outward(tick.plan),
            rebased=tick.rebased or self._first,
        )
        self._first = False
        self._say(Played(told, self._own_resets, self._link.remaining))

    def _tell_state(self) -> None:
        unarmed = self._change.state in (LinkState.READY, LinkState.WAITING) and not self._armed
        lost = LinkChange(self.robot, LinkState.LOST, _UNARMED)
        self._tell(lost if unarmed else self._change)

    def _tell(self, message: LinkChange | PlanAnswer) -> None:
        if self._say is not None:
            self._say(message)

    def _inward(self, key: PlanKey) -> PlanKey:
        return PlanKey(self._start, self._resets, key.target + self._offset, key.last_played)

    def _outward(self, key: PlanKey) -> PlanKey:
        return PlanKey(self._daemon, self._own_resets, key.target - self._offset, key.last_played)
