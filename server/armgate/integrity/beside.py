"""Judges a recorded run under other rules, while the robots go on as they were recorded.

Whatever the other rules say, the recorded plan is what the link took and played: so each command is judged
where the robots then were, not where these rules would have brought them.
"""

from collections.abc import Sequence

import numpy as np

from armgate.cell.events import Command, GateEvent, GateOutput, Plan, Stopped, Verdict
from armgate.integrity.certificate import Budget
from armgate.integrity.gate import Gate
from armgate.integrity.judge import Decision
from armgate.integrity.robot import RobotState, end_of


class GateBeside(Gate):
    """A gate that judges, and then follows what a recording says was answered."""

    def step_beside(self, event: GateEvent, recorded: Sequence[GateOutput]) -> list[GateOutput]:
        """Takes an event, returns what these rules answer, and goes on as was answered then."""
        slot = self._of(event.robot).slot if isinstance(event, Command) else -1
        outputs = self.step(event)
        if isinstance(event, Command):
            self._follow_command(self._of(event.robot), slot, recorded)
        self._follow_stops(outputs, recorded)
        return outputs

    def _follow_command(self, s: RobotState, slot: int, recorded: Sequence[GateOutput]) -> None:
        plan = next((output for output in recorded if isinstance(output, Plan)), None)
        verdict = next((output for output in recorded if isinstance(output, Verdict)), None)
        s.slot = slot if verdict is None or verdict.target is None else verdict.target
        if s.pending != plan:
            if s.pending is not None:
                self._reservations.drop(s)
            if plan is not None:
                self._reservations.stage(s, plan, self._as_played(s, plan))

    def _as_played(self, s: RobotState, plan: Plan) -> Decision:
        """The recorded plan with what can be said of it at once; the rest is proven where it matters."""
        occupied = s.occupancy_to(end_of(s.setpoint, plan.increments))
        swept = self._clearance.space.sweep(s.index, occupied)
        anything = np.full_like(self._clearance.limits, -np.inf)
        judged = self._clearance.judge(s.index, swept, None, anything, Budget(0))
        return Decision(plan.increments, 1.0, (), occupied, swept, judged.lb)

    def _follow_stops(self, outputs: Sequence[GateOutput], recorded: Sequence[GateOutput]) -> None:
        mine = [output for output in outputs if isinstance(output, Stopped)]
        theirs = [output for output in recorded if isinstance(output, Stopped)]
        if mine == theirs:
            return
        for stop in mine:
            for index in self._stops.pop(stop.id):
                self._robots[index].stops.remove(stop.id)
                self._robots[index].faulted = False
        for stop in theirs:
            self._next_stop = stop.id
            self._raise_stop([self._of(robot) for robot in stop.robots], stop.reason, stop.by)
        if not theirs:
            self._next_stop -= len(mine)
