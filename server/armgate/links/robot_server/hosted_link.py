"""Link in the robot server, used by successive daemons.

A link outlives daemons, but each daemon gets it as a new one: ticks are numbered from where the daemon
resumes, and keys of plans carry the daemon's start id and its count of resets. Three rules follow:

- A plan of a former daemon is played to its end. The next daemon gets no tick before the robot rests.
- Only the very first daemon finds the link armed. Every later one has to rebase it, which an operator's reset
  does: links never re-arm automatically.
- Without a daemon no plan is accepted.
"""

import secrets
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.kind import LinkContext, make_link
from armgate.links.link import LinkEvent, SelfClockedLink
from armgate.links.robot_server.messages import ResumePoint, TickReport

if TYPE_CHECKING:
    from armgate.cell.cell import Cell, Robot

Send = Callable[[TickReport | LinkChange | PlanAnswer], None]
"""Sends a message to the attached daemon."""

_STILL = 1e-6
"""Largest motion within a tick of a robot at rest, rad or m."""

_UNARMED = "the robot server had another connection to a daemon before: reset the stop to re-arm its robots"
_ENDING = "the robot server is ending"


class HostedLink:
    """Link of one robot in the robot server.

    Args:
        link: The link; its plans carry ``start``.
        start: Start id of the robot server.
        tolerance: Rounding of the measured q, rad or m.
        lag_window: Declared time for which the robot may still follow older setpoints, s.
    """

    def __init__(self, link: SelfClockedLink, start: str, tolerance: float, lag_window: float) -> None:
        self._link = link
        self._start = start
        self._noise = max(2.0 * tolerance, _STILL)  # two measurements of a resting robot differ by that
        self._lag_window = lag_window
        self._change = LinkChange(link.robot, LinkState.WAITING, "the robot has not sent anything yet")
        self._resets = 0
        self._last: Tick | None = None
        self._still_since: float | None = None
        self._send: Send | None = None
        self._daemon = ""
        self._had_daemon = self._armed = self._reports_ticks = self._mark_rebased = False
        self._next = self._offset = self._daemon_resets = 0

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._link.robot

    @property
    def resting(self) -> bool:
        """True if no increment is left to play."""
        return not self._link.remaining

    async def open(self) -> None:
        """Open the link."""
        await self._link.open(self._receive)

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    # --- daemons ------------------------------------------------------------------------------------------

    def attach(self, start: str, resume: ResumePoint, send: Send) -> None:
        """Attach the daemon with this start id."""
        self._daemon, self._send = start, send
        self._armed, self._had_daemon = not self._had_daemon, True
        self._reports_ticks, self._mark_rebased = False, resume.tick > 0
        self._next, self._daemon_resets = resume.tick, resume.resets
        self._report_state()

    def detach(self) -> None:
        """Detach the daemon; its plan is played to the end."""
        self._send, self._armed = None, False

    def disarm(self) -> None:
        """Accept no further plan: the robot server is ending."""
        self._armed = False
        self._change = LinkChange(self.robot, LinkState.LOST, _ENDING)
        self._report_state()

    def offer(self, plan: Plan) -> None:
        """Offer the daemon's plan to the link, and send the answer."""
        if not self._armed or not self._reports_ticks:
            answer = PlanAnswer(self.robot, plan.key, False, "inactive")
        elif plan.key.start != self._daemon or plan.key.resets != self._daemon_resets:
            answer = PlanAnswer(self.robot, plan.key, False, "mismatch")
        else:
            answer = replace(self._link.offer(replace(plan, key=self._inward(plan.key))), key=plan.key)
        self._report(answer)

    def rebase(self, rebase: Rebase) -> None:
        """Arm the robot at rest, at its present position, after an operator's reset.

        Do nothing while a plan is still played: the gate already refuses such a reset.
        """
        if not self.resting:
            return
        self._resets += 1
        self._daemon_resets, self._armed = rebase.resets, True
        self._link.rebase(replace(rebase, resets=self._resets))
        if self._change.state is LinkState.READY:  # a link that was lost reports later that it is ready
            self._report_state()

    # --- the robot ----------------------------------------------------------------------------------------

    def _receive(self, event: LinkEvent) -> None:
        if isinstance(event, Tick):
            self._watch_rest(event)
            self._report_tick(event)
        else:
            self._change = event
            self._report_state()

    def _watch_rest(self, tick: Tick) -> None:
        before, self._last = self._last, tick
        moved = 0.0 if before is None else max(abs(a - b) for a, b in zip(tick.q, before.q, strict=True))
        if self._link.remaining or any(tick.increment) or moved > self._noise:
            self._still_since = None
        elif self._still_since is None:
            self._still_since = tick.time

    def _report_tick(self, tick: Tick) -> None:
        if self._send is None:
            return
        if not self._reports_ticks:
            if self._still_since is None or tick.time - self._still_since < self._lag_window:
                return
            self._reports_ticks, self._offset = True, tick.tick - self._next
        renumbered = replace(
            tick,
            tick=tick.tick - self._offset,
            plan=None if tick.plan is None else self._outward(tick.plan),
            rebased=tick.rebased or self._mark_rebased,
        )
        self._mark_rebased = False
        self._send(TickReport(renumbered, self._daemon_resets, self._link.remaining))

    def _report_state(self) -> None:
        unarmed = self._change.state in (LinkState.READY, LinkState.WAITING) and not self._armed
        lost = LinkChange(self.robot, LinkState.LOST, _UNARMED)
        self._report(lost if unarmed else self._change)

    def _report(self, message: LinkChange | PlanAnswer) -> None:
        if self._send is not None:
            self._send(message)

    def _inward(self, key: PlanKey) -> PlanKey:
        """Return the link's key for a daemon's key."""
        return PlanKey(self._start, self._resets, key.target + self._offset, key.last_played)

    def _outward(self, key: PlanKey) -> PlanKey:
        """Return the daemon's key for a link's key."""
        return PlanKey(self._daemon, self._daemon_resets, key.target - self._offset, key.last_played)


def host_links(
    cell: "Cell", now: Callable[[], float], note: Callable[[str, str], None] = lambda robot, text: None
) -> list[HostedLink]:
    """Make the links of all robots, in the order of the configuration.

    Args:
        cell: The cell.
        now: Clock that stamps ticks, s.
        note: Called with the name of a robot and a note to the operator about what the robot sends.

    Raises:
        ConfigError: A robot's link cannot be made as configured; the text names file, line and key.
    """
    start = secrets.token_hex(8)

    def hosted(robot: "Robot") -> HostedLink:
        context = LinkContext(start, now, lambda text: note(robot.name, text))
        return HostedLink(make_link(cell, robot, context), start, robot.q_tolerance, robot.lag_window)

    return [hosted(robot) for robot in cell.robots]
