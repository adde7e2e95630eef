"""Gate for replays: decides under its own rules, while the robots move as recorded.

The link played the recorded plans, whatever these rules would have admitted. So each command is decided at
the recorded positions of the robots, not at those that would result from these rules.
"""

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from armgate.events import (
    Command,
    GateEvent,
    GateOutput,
    Joints,
    Plan,
    Point,
    Rebase,
    Reset,
    ResetAnswer,
    Stopped,
    Verdict,
)
from armgate.gate.braking import end_of, stop_increments
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.pair_check import in_pair_order
from armgate.gate.decision import Decision
from armgate.gate.gate import Gate
from armgate.gate.joint_limits import limit_increment
from armgate.gate.occupancy import occupancy_to
from armgate.gate.robot import RobotState
from armgate.gate.step_bounds import StepBounds
from armgate.gate.stops import StopCause, Stops


@dataclass(frozen=True, slots=True)
class IntendedMotion:
    """Motion that a command would have caused, for all joints of its robot, rad or m.

    Attributes:
        commanded: The commanded increment.
        limited: The increment within the robot's own bounds.
        end: Position at the end of its stop.
        q: The measured position.
        setpoint: The setpoint to which it would be added.
        last: The increment played last.
        bounds: The robot's bounds per tick.
        share: Speed bound of the lease, as a fraction.
    """

    commanded: Joints
    limited: Joints
    end: Joints
    q: Joints
    setpoint: Joints
    last: Joints
    bounds: StepBounds
    share: float


class ReplayGate(Gate):
    """Gate that decides by its own rules, gives access to its data, and then follows the recorded outputs."""

    def intended(self, event: Command) -> IntendedMotion | None:
        """Return the motion that a command would cause now; None if its increment is invalid."""
        s = self._of(event.robot)
        if s.tick < 0 or len(event.dq) != len(s.zeros) or not all(map(math.isfinite, event.dq)):
            return None
        bounds = s.limits_now()
        limited = limit_increment(event.dq, s.last, s.brake, s.setpoint, bounds, s.share).u
        increments = stop_increments(limited, s.bounds.decel)
        end = end_of(s.setpoint, increments)
        return IntendedMotion(event.dq, limited, end, s.measured, s.setpoint, s.last, bounds, s.share)

    def witness(self, robot: str, pair: tuple[str, str], q: Joints) -> tuple[Point, Point] | None:
        """Return the nearest points of a pair's bodies, in its order, with ``robot`` at ``q``.

        None if the cell has no such pair of this robot, or the position of a robot is unknown.
        """
        c, s = self._clearance, self._of(robot)
        found = [p for p in c.pairs_of[s.index] if c.names(int(p)) == pair]
        if not found or not c.positions_known(int(found[0])):
            return None
        group, k = c.find(s.index, int(found[0]))
        mine = c.space.still(s.index, q)
        side = c.space.static
        if group.other is not None:
            other = self._robots[group.other]
            side = mine if other is s else c.space.still(other.index, other.measured)
        return in_pair_order(group, k, c.certifier.prove(group, k, mine, side, (0, 0)).points)

    def step_following(self, event: GateEvent, recorded: Sequence[GateOutput]) -> list[GateOutput]:
        """Process an event, return the outputs under these rules, and follow the recorded outputs."""
        before = deepcopy(self._stops)
        if isinstance(event, Command):
            s = self._of(event.robot)
            slot, waiting = s.slot, s.pending
            outputs = self.step(event)
            self._follow_command(s, slot, waiting, recorded)
        elif isinstance(event, Reset):
            outputs = self._follow_reset(event, before, recorded)
        else:
            outputs = self.step(event)
        self._follow_stops(before, outputs, recorded)
        return outputs

    def _follow_command(
        self, s: RobotState, slot: int, waiting: Plan | None, recorded: Sequence[GateOutput]
    ) -> None:
        """Adopt the recorded plan. If there is none, a plan that waited for its answer still waits."""
        plan = next((output for output in recorded if isinstance(output, Plan)), waiting)
        verdict = next((output for output in recorded if isinstance(output, Verdict)), None)
        s.slot = slot if verdict is None or verdict.target is None else verdict.target
        if s.pending != plan:
            if s.pending is not None:
                self._reservations.drop_pending(s)
            if plan is not None:
                self._reservations.stage(s, plan, self._as_played(s, plan))

    def _follow_reset(self, event: Reset, stopped: Stops, recorded: Sequence[GateOutput]) -> list[GateOutput]:
        """Answer a reset by these rules, then lift or keep the stop as recorded."""
        before = [(s.setpoint, s.resets, s.slot) for s in self._robots]
        outputs = self.step(event)
        lifted = any(isinstance(output, ResetAnswer) and output.accepted for output in recorded)
        stop = self._stops.find(event.stop)
        if lifted and stop is not None:
            self._stops.lift(stop)
        elif not lifted:
            self._stops = stopped
            for s, kept in zip(self._robots, before, strict=True):
                s.setpoint, s.resets, s.slot = kept
        self._note_stops(self._robots)
        for rebase in (output for output in recorded if isinstance(output, Rebase)):
            self._rebase_as(rebase)
        return outputs

    def _rebase_as(self, rebase: Rebase) -> None:
        s = self._of(rebase.robot)
        if (s.setpoint, s.resets) != (rebase.setpoint, rebase.resets):
            s.rebase(rebase.setpoint)
            s.resets = rebase.resets
            self._reservations.reserve_held_plan(s)
            self._reservations.prove_anew(s)

    def _as_played(self, s: RobotState, plan: Plan) -> Decision:
        """Return the recorded plan as a decision, with the bounds that are known without a query."""
        occupied = occupancy_to(s, end_of(s.setpoint, plan.increments), plan.increments[0])
        swept = self._clearance.sweep(s.index, occupied)
        most = np.full_like(self._clearance.limits_of[s.index], np.inf)
        checked = self._clearance.check(s.index, swept, None, most, Budget(0))
        self._clearance.mark_maybe_below()
        return Decision(plan.increments, 1.0, (), occupied, swept, checked.lb)

    def _follow_stops(
        self, before: Stops, outputs: Sequence[GateOutput], recorded: Sequence[GateOutput]
    ) -> None:
        """Replace the stops that these rules raised by the recorded ones."""
        mine = [output for output in outputs if isinstance(output, Stopped)]
        theirs = [output for output in recorded if isinstance(output, Stopped)]
        if mine == theirs:
            return
        for stop in mine:
            for robot in stop.robots:
                self._of(robot).faulted = False
        self._stops = before
        for stop in theirs:
            robots = tuple(self._of(robot).index for robot in stop.robots)
            self._stops.put(stop.id, robots, StopCause(stop.by, stop.reason), stop.replaces)
        self._note_stops(self._robots)
