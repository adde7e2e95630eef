"""Why a command was limited or refused: what was known when it was judged, and how to say it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from armgate.audit.replaying import fitting_steps, gate_for, judged
from armgate.cell.cell import Cell, Robot
from armgate.cell.escaping import printable
from armgate.events import Cause, Command, Joints, Outcome, Point, Reason, Verdict
from armgate.gate import GateBeside, Intended
from armgate.recording import Recording


@dataclass(frozen=True, slots=True)
class Case:
    """One judged command with all that explains it.

    Attributes:
        time: Daemon time, s.
        command: What was asked for.
        verdict: What was answered.
        intended: Where it would have led; None if that cannot be said.
        positions: All robots' measured positions.
        points: Nearest points of the binding pair at the end of the stop, where clearance bound.
    """

    time: float
    command: Command
    verdict: Verdict
    intended: Intended | None
    positions: Mapping[str, Joints]
    points: tuple[Point, Point] | None

    @property
    def reason(self) -> Reason | None:
        """The last check that bound it."""
        return self.verdict.reasons[-1] if self.verdict.reasons else None

    @property
    def tick(self) -> int:
        """The tick that it was meant for."""
        return self.verdict.based_on + 1 if self.verdict.target is None else self.verdict.target


Wanted = Callable[[Verdict], bool]


def at_tick(tick: int, robot: str | None) -> Wanted:
    """Commands for one tick."""

    def wanted(verdict: Verdict) -> bool:
        target = verdict.based_on + 1 if verdict.target is None else verdict.target
        return target == tick and robot in (None, verdict.robot)

    return wanted


def first_refusals(robot: str | None) -> Wanted:
    """Refused commands: of those that follow each other for the same reason, the first."""
    newest: dict[str, tuple[int, object]] = {}

    def wanted(verdict: Verdict) -> bool:
        if verdict.outcome is not Outcome.REFUSED or robot not in (None, verdict.robot):
            return False
        last = verdict.reasons[-1] if verdict.reasons else None
        why = last and (last.cause, last.joint, last.pair)
        seq, before = newest.get(verdict.robot, (-2, None))
        newest[verdict.robot] = (verdict.seq, why)
        return (seq + 1, before) != (verdict.seq, why)

    return wanted


def cases(recording: Recording, cell: Cell, wanted: Wanted) -> Iterator[Case]:
    """The commands that are asked for, one by one; judged again up to each.

    Raises:
        RecordingError: The recording is damaged or has a gap.
    """
    gate = gate_for(recording.header, cell)
    for time, step in fitting_steps(recording, cell):
        event = step.event
        verdict = next((o for o in step.outputs if isinstance(o, Verdict)), None)
        if isinstance(event, Command) and verdict is not None and wanted(verdict):
            yield _case(gate, cell, time, event, verdict)
        judged(recording, gate, time, event)


def _case(gate: GateBeside, cell: Cell, time: float, command: Command, verdict: Verdict) -> Case:
    intended = gate.intended(command)
    positions = {robot.name: gate.view(robot.name).q for robot in cell.robots}
    reason = verdict.reasons[-1] if verdict.reasons else None
    points = None
    if reason is not None and reason.pair is not None and intended is not None:
        points = gate.witness(command.robot, reason.pair, intended.end)
    return Case(time, command, verdict, intended, positions, points)


# --- in words ---------------------------------------------------------------------------------------------

_MEANING: dict[Cause, str] = {
    Cause.LEASE: "Nobody may command a robot without holding it: acquire it first.",
    Cause.FENCE: "The command carried the number of a former lease; whoever holds the robot now has another.",
    Cause.STOPPED: "A stop is in force: an operator resets it, then the robot must be acquired again.",
    Cause.LINK: "The way to the robot was not ready.",
    Cause.STALE: "It was based on a state that is too old: the controller or the network was slow.",
    Cause.AHEAD: "It was based on a tick that has not come yet.",
    Cause.OCCUPIED: "A command for that tick was judged already: one per robot and tick.",
    Cause.LENGTH: "It had not one increment for each joint.",
    Cause.NOT_FINITE: "It asked for NaN or infinity.",
    Cause.INCREMENT: "It asked for more than the joint's largest speed, or than the lease's share of it.",
    Cause.ACCELERATION: "It asked for a change of speed beyond the joint's acceleration.",
    Cause.JOINT_LIMIT: "Braking from there, the robot would have passed the joint's limit.",
    Cause.CLEARANCE: "On its way to rest the robot could have come nearer than the distance to keep.",
}


def words(case: Case, cell: Cell) -> str:
    """The case in a few lines."""
    v, robot = case.verdict, cell.robot(case.command.robot)
    lines = [f"{v.robot}, tick {case.tick} ({case.time:.3f} s), seq {v.seq}: {v.outcome.value}"]
    if v.outcome is Outcome.LIMITED and v.beta < 1.0:
        lines[0] += f", {100 * v.beta:.0f} % of the way from braking on (0) to what the bounds leave (1)"
    for reason in v.reasons:
        lines.append(f"  {reason.text}")
        lines.append(f"    {_MEANING[reason.cause]}")
    if not v.reasons:
        lines.append("  nothing bound it")
    if len(case.command.dq) == robot.model.n:
        lines += _increments(robot, case.command.dq, v.dq)
    if case.reason is not None and case.reason.pair is not None:
        lines += _clearance(case)
    return "\n".join(map(printable, lines))


def _increments(robot: Robot, asked: Joints, given: Joints) -> list[str]:
    lines = ["  asked → plays this tick"]
    for joint, a, b in zip(robot.model.joints, asked, given, strict=True):
        mark = "" if a == b else "   ←"
        lines.append(f"    {joint.name}: {_shown(joint.kind, a)} → {_shown(joint.kind, b)}{mark}")
    return lines


def _shown(kind: str, value: float) -> str:
    factor, unit = (57.29577951308232, "°") if kind == "revolute" else (1000.0, " mm")
    return f"{factor * value:+.4f}{unit}"


def _clearance(case: Case) -> list[str]:
    reason = case.reason
    assert reason is not None
    assert reason.pair is not None
    lines = []
    if reason.value is not None and reason.bound is not None:
        lines.append(f"  short by {1000 * (reason.bound - reason.value):.4f} mm")
    if case.points is not None:
        distance = sum((a - b) ** 2 for a, b in zip(*case.points, strict=True)) ** 0.5
        lines.append(f"  at the end of that stop: nearest points {1000 * distance:.1f} mm apart, at")
        for name, point in zip(reason.pair, case.points, strict=True):
            lines.append(f"    {name}: ({', '.join(f'{x:.3f}' for x in point)}) m")
        lines.append("  other timings of other robots are counted too, so that the bound may be lower")
    return lines
