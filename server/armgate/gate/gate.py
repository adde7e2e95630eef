"""The gate: events in, verdicts and plans out. Pure and deterministic, so recorded events can be replayed.

The invariant: at every moment the occupancies of all robots are inside the joint limits and clear of each
other, of themselves and of the surroundings by at least the stop distance, for every timing. A command is
admitted if and only if its robot's new occupancy keeps the invariant against the occupancies that the others
hold. So robots may run on independent clocks, commands are decided one at a time, and every robot can come
to rest safely, even if clients and links are lost.
"""

from operator import add
from typing import assert_never

from armgate.cell.cell import Cell
from armgate.events import (
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
from armgate.gate import verdict_wording
from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import GAP
from armgate.gate.clearance.compiled_nearest import nearest_pairs_of
from armgate.gate.command_checks import failed_check
from armgate.gate.decision import Decision, DecisionMaker
from armgate.gate.occupancy import deviation, settle_measured
from armgate.gate.reservations import Reservations
from armgate.gate.robot import RobotState, RobotView
from armgate.gate.stops import FAULT, LINK, MET, StopCause, Stops
from armgate.gate.tick_checks import contradiction, unusable

_NEAREST = 3
"""Number of nearest pairs that a state reports of each robot."""

_GAP_RATE = 1000
"""Number of engine queries per gap; more gaps cause a warning."""


class Gate:
    """Safety gate of one cell: decides about commands, and keeps the invariant over all events.

    Args:
        cell: The cell.
        start: The daemon's start id; it becomes a part of the plans' keys.
        compiled: True to compile the inner loops by numba, False for numpy; by default compiled if numba is
            installed. Both forms agree up to rounding errors; a replay in the form of its run is identical.
    """

    def __init__(self, cell: Cell, start: str, compiled: bool | None = None) -> None:
        self._cell = cell
        self._start = start
        self._clearance = Clearance(cell, compiled)
        self._nearest = nearest_pairs_of(self._clearance)
        self._decisions = DecisionMaker(self._clearance, cell.config.response)
        self._robots = [RobotState.of(r, i) for i, r in enumerate(cell.robots)]
        self._reservations = Reservations(self._clearance)
        self._stops = Stops()

    def step(self, event: GateEvent) -> list[GateOutput]:
        """Process one event and return its outputs.

        Raises:
            ModelError: The event names an unknown robot.
        """
        match event:
            case Tick():
                out = self._tick(event)
            case Command():
                out = self._command(event)
            case PlanAnswer():
                out = self._plan_answer(event)
            case LeaseChange():
                out = self._lease_change(event)
            case Stop():
                out = self._stop(event)
            case Reset():
                out = self._reset(event)
            case LinkChange():
                out = self._link_change(event)
            case _:
                assert_never(event)
        return out

    def view(self, robot: str) -> RobotView:
        """Return the contents of a state about a robot.

        Raises:
            ModelError: There is no such robot.
        """
        return self._of(robot).view

    def warnings(self) -> tuple[str, ...]:
        """Return warnings for the state that concern no single robot."""
        queries, gaps = self._clearance.certifier.queries, self._clearance.certifier.gaps
        if gaps * _GAP_RATE <= queries:
            return ()
        text = f"distance engine: {gaps} of {queries} distances differ from the proven bound by more than"
        return (f"{text} {1000.0 * GAP:g} mm",)

    # --- ticks ---------------------------------------------------------------------------------------------

    def _tick(self, event: Tick) -> list[GateOutput]:
        s = self._of(event.robot)
        wrong = unusable(s, event)
        if wrong is not None:
            return self._stop_untracked(s, wrong)
        if s.tick < 0:
            return self._first_tick(s, event)
        fault = self._follow_plan(s, event)
        occupied = [r.occupied for r in s.reserved]
        settled = settle_measured(event.q, occupied, s.robot.q_tolerance, s.companion_margin)
        off_path = 0.0 if settled is not None else min(deviation(event.q, one) for one in occupied)
        if settled is None and fault is None:
            fault = f"{s.name} measured {off_path:.4g} rad or m off its stop path"
        s.take_tick(event, event.q if settled is None else settled)
        self._reservations.reserve_held_plan(s)
        if event.rebased:
            self._reservations.prove_anew(s)
        out = self._fault(s, fault, off_path) if fault is not None else []
        self._update_nearest(s)
        return out

    def _first_tick(self, s: RobotState, event: Tick) -> list[GateOutput]:
        fault = contradiction(s, event)
        s.take_tick(event, event.q)
        self._reservations.reserve_held_plan(s)
        self._reservations.prove_anew(s)
        out = self._fault(s, fault, 0.0) if fault is not None else []
        self._update_nearest(s)
        return out

    def _stop_untracked(self, s: RobotState, why: str) -> list[GateOutput]:
        """Stop a robot whose tick cannot be used; its reservations stay."""
        known, s.untracked = s.untracked, True
        return [] if known else [self._raise_stop([s], why, "gate", LINK)]

    def _follow_plan(self, s: RobotState, event: Tick) -> str | None:
        """Follow the plan that the link played; return a contradiction as text, None if there is none."""
        if s.pending is not None:
            if event.plan == s.pending.key:
                self._reservations.accept_pending(s)
            elif event.tick >= s.pending.key.target:
                s.late += not event.rebased  # when its answer arrives, no plan is pending
                self._reservations.drop_pending(s)
        wrong = contradiction(s, event)
        if event.rebased or event.plan is None:
            s.held, s.played = None, -1
        elif wrong is None and s.held is not None:
            s.played = event.index
            if event.index == 0:
                s.applied_seq = s.held.seq
        return wrong

    def _update_nearest(self, s: RobotState) -> None:
        measured = [r.measured if r.tick >= 0 else None for r in self._robots]
        nearest = self._nearest.find(s.index, measured, _NEAREST)
        s.nearest = tuple(nearest.values())
        for pair, near in nearest.items():
            if near.points is not None and self._cell.pairs[pair].kind != "self":
                s.least = near.distance if s.least is None else min(s.least, near.distance)

    # --- commands ------------------------------------------------------------------------------------------

    def _command(self, event: Command) -> list[GateOutput]:
        s = self._of(event.robot)
        reason = failed_check(event, s, self._cell.config.max_age_ticks) or self._positions_unknown()
        if reason is not None:
            return [self._verdict(s, event, Decision(s.remaining, 0.0, (reason,)), None)]
        decision = self._decisions.decide(event.dq, s, self._robots)
        s.slot = s.tick + 1
        verdict = self._verdict(s, event, decision, s.slot)
        if verdict.outcome is Outcome.REFUSED:
            return [verdict]
        key = PlanKey(self._start, s.resets, s.slot, s.played)
        plan = Plan(s.name, key, event.seq, decision.increments)
        self._reservations.stage(s, plan, decision)
        return [verdict, plan]

    def _positions_unknown(self) -> Reason | None:
        missing = [r.name for r in self._robots if r.tick < 0]
        return verdict_wording.positions_unknown(missing) if missing else None

    def _verdict(self, s: RobotState, command: Command, decision: Decision, target: int | None) -> Verdict:
        dq = decision.increments[0] if decision.increments else s.zeros
        setpoint = tuple(map(add, s.setpoint or s.zeros, dq))
        outcome = Outcome.REFUSED if target is None else _outcome(command.dq, decision)
        given = () if outcome is Outcome.ADMITTED else decision.reasons
        # Counted under the last check that limited it.
        key = f"{outcome}:{given[-1].cause}" if given else str(outcome)
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
            reasons=given,
        )
        return s.verdict

    def _plan_answer(self, event: PlanAnswer) -> list[GateOutput]:
        s = self._of(event.robot)
        if s.pending is None or event.key != s.pending.key:
            return []
        if event.accepted:
            self._reservations.accept_pending(s)
        else:
            s.late += event.reason == "late"
            self._reservations.drop_pending(s)
        return []

    # --- leases, stops, links ------------------------------------------------------------------------------

    def _lease_change(self, event: LeaseChange) -> list[GateOutput]:
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
        """Set the setpoint to the position at which the robot stands, if that is proven to be clear.

        The bounds of a robot that faulted are void: its pairs are proven anew at the measured position.
        """
        setpoint, faulted = s.setpoint_after_reset(), s.faulted
        moves = setpoint != s.setpoint and not faulted
        if moves and not self._reservations.prove_setpoint(s, setpoint):
            setpoint = s.setpoint
        s.rebase(setpoint)
        self._reservations.reserve_held_plan(s)
        if faulted:
            s.faulted = False
            self._decisions.forget(s.index)
            self._reservations.prove_anew(s)
        return Rebase(s.name, s.setpoint, s.resets)

    def _link_change(self, event: LinkChange) -> list[GateOutput]:
        s = self._of(event.robot)
        s.link = event.state
        match event.state:
            case LinkState.WAITING | LinkState.READY:
                return []
            case LinkState.LOST | LinkState.FAULTED:
                s.untracked = True
                reason = f"the link to {s.name} is {event.state.value}: {event.reason}"
                return [self._raise_stop([s], reason, "gate", LINK)]
            case _:
                assert_never(event.state)

    def _fault(self, s: RobotState, reason: str, off_path: float) -> list[GateOutput]:
        """Stop a robot that is outside its occupancy, and the robots whose stop paths may now meet it.

        Its occupancy starts from the measured position, widened by its total distance off its path.
        """
        s.off_path += off_path
        self._reservations.reserve_held_plan(s)
        self._reservations.prove_anew(s)
        out: list[GateOutput] = []
        if not s.faulted:
            out.append(self._raise_stop([s], reason, "gate", FAULT))
        s.faulted = True
        why = f"its stop path may meet {s.name}, which faulted"
        out += [self._raise_stop([other], why, "gate", MET) for other in self._met_by(s) if not other.stops]
        return out

    def _met_by(self, s: RobotState) -> list[RobotState]:
        """Return the other robots that share a pair below its limit with a robot."""
        pairs = [self._cell.pairs[k] for k in self._clearance.below(s.index)]
        met = {self._cell.bodies[k].robot for p in pairs for k in (p.a, p.b)}
        return [r for r in self._robots if r.index in met and r is not s]

    def _of(self, robot: str) -> RobotState:
        return self._robots[self._cell.robot_index(robot)]


def _outcome(dq: Joints, decision: Decision) -> Outcome:
    if decision.increments[0] == dq or not decision.reasons:
        return Outcome.ADMITTED
    return Outcome.REFUSED if decision.beta == 0.0 else Outcome.LIMITED
