"""The gate: events in, verdicts and plans out. Pure and deterministic: the event log is the replay.

The invariant: at every moment the occupancies of all robots are inside the joint limits and clear of each
other, of themselves and of the surroundings by at least the stop distance, for every timing. A command is
admitted if and only if its robot's new occupancy keeps the invariant against those that the others hold. So
robots may run on independent clocks, commands are judged one at a time, and whatever is lost, every robot
can rest safely.
"""

from collections.abc import Callable
from typing import Any

from armgate.cell.cell import Cell
from armgate.events import (
    Cause,
    Command,
    GateEvent,
    GateOutput,
    Joints,
    LeaseChange,
    LinkChange,
    LinkState,
    Outcome,
    Plan,
    PlanAnswer,
    PlanKey,
    Reason,
    Rebase,
    Reset,
    ResetAnswer,
    Stop,
    Stopped,
    Tick,
    Verdict,
)
from armgate.gate.admission import inadmissible
from armgate.gate.clearance import Clearance
from armgate.gate.judge import Decision, Judge
from armgate.gate.nearest import NearestPairs
from armgate.gate.occupancy import deviation, settle_measured
from armgate.gate.played import contradiction, unreadable
from armgate.gate.reservations import Reservations
from armgate.gate.robot import RobotState, robot_state
from armgate.gate.stops import FAULT, LINK, MET, StopCause, Stops
from armgate.gate.view import RobotView, view_of

_NEAREST = 3


class Gate:
    """Judges what robots are asked to do.

    Args:
        cell: The cell.
        start: The daemon's start id; goes into the plans' keys.
        compiled: Whether its inner loops are compiled by numba; where it is installed, if it is not said.
            Both forms are the same to rounding; a replay is identical in the form of its run.
    """

    def __init__(self, cell: Cell, start: str, compiled: bool | None = None) -> None:
        self._cell = cell
        self._start = start
        self._clearance = Clearance(cell, compiled)
        self._nearest = NearestPairs(self._clearance)
        self._judge = Judge(self._clearance, cell.config.response)
        self._robots = [robot_state(r, i) for i, r in enumerate(cell.robots)]
        self._reservations = Reservations(self._clearance)
        self._stops = Stops()

    def step(self, event: GateEvent) -> list[GateOutput]:
        """Takes one event and returns what follows from it.

        Raises:
            ModelError: The event names an unknown robot.
        """
        return _HANDLERS[type(event)](self, event)

    def view(self, robot: str) -> RobotView:
        """Returns what the state tells of a robot.

        Raises:
            ModelError: There is no such robot.
        """
        return view_of(self._of(robot))

    def warnings(self) -> tuple[str, ...]:
        """Returns what is worth saying beside the robots' entries."""
        asked, gaps = self._clearance.certifier.queries, self._clearance.certifier.gaps
        if gaps * _GAP_RATE <= asked:
            return ()
        return (f"distance engine: {gaps} of {asked} answers fell short of their proof",)

    # --- the clock -----------------------------------------------------------------------------------------

    def _tick(self, event: Tick) -> list[GateOutput]:
        s = self._of(event.robot)
        wrong = unreadable(s, event)
        if wrong is not None:
            return self._not_heard(s, wrong)
        if s.tick < 0:
            return self._first_tick(s, event)
        fault = self._resolve(s, event)
        occupied = [r.occupied for r in s.reserved]
        settled = settle_measured(event.q, occupied, s.robot.q_tolerance, s.off_companion)
        strayed = 0.0 if settled is not None else min(deviation(event.q, one) for one in occupied)
        if settled is None and fault is None:
            fault = f"{s.name} measured {strayed:.4g} rad or m off its stop path"
        s.take_tick(event, event.q if settled is None else settled)
        self._reservations.hold_plan(s)
        if event.rebased:
            self._reservations.renew(s)
        out = self._fault(s, fault, strayed) if fault is not None else []
        self._report(s)
        return out

    def _first_tick(self, s: RobotState, event: Tick) -> list[GateOutput]:
        fault = contradiction(s, event)
        s.take_tick(event, event.q)
        self._reservations.hold_plan(s)
        self._reservations.renew(s)
        out = self._fault(s, fault, 0.0) if fault is not None else []
        self._report(s)
        return out

    def _not_heard(self, s: RobotState, why: str) -> list[GateOutput]:
        """Stops a robot whose tick says nothing of it; what was reserved for it stays."""
        known, s.unheard = s.unheard, True
        return [] if known else [self._raise_stop([s], why, "gate", LINK)]

    def _resolve(self, s: RobotState, event: Tick) -> str | None:
        """Follows what the link played; returns what contradicts it, None if nothing does."""
        if s.pending is not None:
            if event.plan == s.pending.key:
                self._reservations.take_over(s)
            elif event.tick >= s.pending.key.target:
                s.late += not event.rebased  # its answer will find nothing pending
                self._reservations.drop(s)
        wrong = contradiction(s, event)
        if event.rebased or event.plan is None:
            s.held, s.played = None, -1
        elif wrong is None and s.held is not None:
            s.played = event.index
            if event.index == 0:
                s.applied_seq = s.held.seq
        return wrong

    def _report(self, s: RobotState) -> None:
        measured = [r.measured if r.tick >= 0 else None for r in self._robots]
        nearest = self._nearest.find(s.index, measured, _NEAREST)
        s.nearest = tuple(nearest.values())
        for pair, near in nearest.items():
            if near.points is not None and self._cell.pairs[pair].kind != "self":
                s.least = near.distance if s.least is None else min(s.least, near.distance)

    # --- commands ------------------------------------------------------------------------------------------

    def _command(self, event: Command) -> list[GateOutput]:
        s = self._of(event.robot)
        reason = inadmissible(event, s, self._cell.config.max_age_ticks) or self._unknown(s)
        if reason is not None:
            return [self._verdict(s, event, Decision(s.remaining, 0.0, (reason,)), None)]
        decision = self._judge.decide(event.dq, s, self._robots)
        s.slot = s.tick + 1
        verdict = self._verdict(s, event, decision, s.slot)
        if verdict.outcome is Outcome.REFUSED:
            return [verdict]
        key = PlanKey(self._start, s.resets, s.slot, s.played)
        plan = Plan(s.name, key, event.seq, decision.increments)
        self._reservations.stage(s, plan, decision)
        return [verdict, plan]

    def _unknown(self, s: RobotState) -> Reason | None:
        missing = [r.name for r in self._robots if r.tick < 0]
        if not missing:
            return None
        return Reason(Cause.LINK, f"the position of {', '.join(missing)} is not known yet: wait for its link")

    def _verdict(self, s: RobotState, command: Command, decision: Decision, target: int | None) -> Verdict:
        dq = decision.increments[0] if decision.increments else s.zeros
        setpoint = tuple(q + u for q, u in zip(s.setpoint or s.zeros, dq, strict=True))
        outcome = Outcome.REFUSED if target is None else _outcome(command.dq, decision)
        reasons = () if outcome is Outcome.ADMITTED else decision.reasons
        # Counted under the last check that bound it.
        key = f"{outcome.value}:{reasons[-1].cause.value}" if reasons else outcome.value
        s.counts[key] = s.counts.get(key, 0) + 1
        s.verdict = Verdict(
            robot=s.name,
            seq=command.seq,
            based_on=command.based_on,
            target=target,
            outcome=outcome,
            beta=decision.beta,
            dq=dq,
            setpoint=setpoint,
            reasons=reasons,
        )
        return s.verdict

    def _answer(self, event: PlanAnswer) -> list[GateOutput]:
        s = self._of(event.robot)
        if s.pending is None or event.key != s.pending.key:
            return []
        if event.accepted:
            self._reservations.take_over(s)
        else:
            s.late += event.reason == "late"
            self._reservations.drop(s)
        return []

    # --- leases, stops, links ------------------------------------------------------------------------------

    def _lease(self, event: LeaseChange) -> list[GateOutput]:
        s = self._of(event.robot)
        s.fence, s.share = event.fence, event.speed
        return []

    def _stop(self, event: Stop) -> list[GateOutput]:
        robots = [self._of(r) for r in event.robots]
        return [self._raise_stop(robots, event.reason, event.by, StopCause(event.by, event.reason))]

    def _raise_stop(self, robots: list[RobotState], reason: str, by: str, cause: StopCause) -> Stopped:
        stop, replaced = self._stops.raise_(tuple(s.index for s in robots), cause)
        self._note_stops(robots)
        return Stopped(stop, tuple(s.name for s in robots), reason, by, replaced)

    def _note_stops(self, robots: list[RobotState]) -> None:
        for s in robots:
            s.stops = self._stops.of(s.index)

    def _reset(self, event: Reset) -> list[GateOutput]:
        stop = self._stops.find(event.stop)
        if stop is None:
            return [ResetAnswer(event.stop, False, "unknown")]
        robots = [self._robots[i] for i in stop.robots]
        if not all(s.tick >= 0 and s.resting for s in robots):
            return [ResetAnswer(event.stop, False, "moving")]
        self._stops.lift(stop)
        self._note_stops(robots)
        lifted = None if stop.id == event.stop else stop.id
        out: list[GateOutput] = [ResetAnswer(event.stop, True, lifted=lifted)]
        return out + [self._rebase(s) for s in robots if not s.stops]

    def _rebase(self, s: RobotState) -> Rebase:
        """Let the setpoints begin where the robot stands, as far as that keeps what is proven.

        What was proven of a robot that faulted is void: it is proven anew at what was measured.
        """
        setpoint, faulted = s.stand(), s.faulted
        moves = setpoint != s.setpoint and not faulted
        if moves and not self._reservations.prove_stand(s, setpoint):
            setpoint = s.setpoint
        s.rebase(setpoint)
        self._reservations.hold_plan(s)
        if faulted:
            s.faulted = False
            self._judge.forget(s.index)
            self._reservations.renew(s)
        return Rebase(s.name, s.setpoint, s.resets)

    def _link(self, event: LinkChange) -> list[GateOutput]:
        s = self._of(event.robot)
        s.link = event.state
        if event.state not in (LinkState.LOST, LinkState.FAULTED):
            return []
        s.unheard = True
        reason = f"the link to {s.name} is {event.state.value}: {event.reason}"
        return [self._raise_stop([s], reason, "gate", LINK)]

    def _fault(self, s: RobotState, reason: str, strayed: float) -> list[GateOutput]:
        """Stop a robot that is not where it can be, and the robots whose stop paths may now meet it.

        Its occupancy starts from what was measured, widened by as much as it has strayed in all.
        """
        s.strayed += strayed
        self._reservations.hold_plan(s)
        self._reservations.renew(s)
        out: list[GateOutput] = []
        if not s.faulted:
            out.append(self._raise_stop([s], reason, "gate", FAULT))
        s.faulted = True
        why = f"its stop path may meet {s.name}, which faulted"
        out += [self._raise_stop([other], why, "gate", MET) for other in self._met_by(s) if not other.stops]
        return out

    def _met_by(self, s: RobotState) -> list[RobotState]:
        pairs = [self._cell.pairs[k] for k in self._clearance.below(s.index)]
        met = {self._cell.bodies[k].robot for p in pairs for k in (p.a, p.b)}
        return [r for r in self._robots if r.index in met and r is not s]

    def _of(self, robot: str) -> RobotState:
        return self._robots[self._cell.robot_index(robot)]


_GAP_RATE = 1000
"""One gap in so many engine queries is worth a warning."""

_HANDLERS: dict[type, Callable[[Gate, Any], list[GateOutput]]] = {
    Tick: Gate._tick,
    Command: Gate._command,
    PlanAnswer: Gate._answer,
    LeaseChange: Gate._lease,
    Stop: Gate._stop,
    Reset: Gate._reset,
    LinkChange: Gate._link,
}


def _outcome(dq: Joints, decision: Decision) -> Outcome:
    if decision.increments[0] == dq or not decision.reasons:
        return Outcome.ADMITTED
    return Outcome.REFUSED if decision.beta == 0.0 else Outcome.LIMITED
