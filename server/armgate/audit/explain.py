"""Explanation of limited and refused commands: the data of the gate when it decided, as text."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from armgate.audit.replay import checked_steps, gate_for, gate_outputs
from armgate.audit.replay_gate import IntendedMotion, ReplayGate
from armgate.cell.cell import Cell, Robot
from armgate.cell.terminal_text import printable
from armgate.events import Command, Joints, Outcome, Point, Reason, Verdict
from armgate.gate.verdict_wording import MEANINGS
from armgate.recording import Recording


@dataclass(frozen=True, slots=True)
class ExplainedCommand:
    """Command with its verdict and the data that explain it.

    Attributes:
        time: Daemon time, s.
        command: The command.
        verdict: Its verdict.
        intended: Motion that it would have caused; None if that is unknown.
        positions: Measured positions of all robots.
        points: Nearest points of the binding pair at the end of the stop, if the clearance was binding.
    """

    time: float
    command: Command
    verdict: Verdict
    intended: IntendedMotion | None
    positions: Mapping[str, Joints]
    points: tuple[Point, Point] | None

    @property
    def reason(self) -> Reason | None:
        """Reason of the last check that limited or refused it."""
        return self.verdict.reasons[-1] if self.verdict.reasons else None

    @property
    def tick(self) -> int:
        """Tick for which it was intended."""
        return self.verdict.based_on + 1 if self.verdict.target is None else self.verdict.target


Wanted = Callable[[Verdict], bool]
"""Predicate that selects verdicts to explain."""


def at_tick(tick: int, robot: str | None) -> Wanted:
    """Return a predicate for the commands of one tick."""

    def wanted(verdict: Verdict) -> bool:
        target = verdict.based_on + 1 if verdict.target is None else verdict.target
        return target == tick and robot in (None, verdict.robot)

    return wanted


def first_refusals(robot: str | None) -> Wanted:
    """Return a predicate for refused commands: the first of consecutive ones with the same reason."""
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


def selected_commands(recording: Recording, cell: Cell, wanted: Wanted) -> Iterator[ExplainedCommand]:
    """Replay a recording and yield the selected commands.

    Raises:
        RecordingError: The recording is damaged or has a gap.
    """
    gate = gate_for(recording.header, cell)
    for time, step in checked_steps(recording, cell):
        event = step.event
        verdict = next((o for o in step.outputs if isinstance(o, Verdict)), None)
        if isinstance(event, Command) and verdict is not None and wanted(verdict):
            yield _explained(gate, cell, time, event, verdict)
        gate_outputs(recording, gate, time, event)


def _explained(
    gate: ReplayGate, cell: Cell, time: float, command: Command, verdict: Verdict
) -> ExplainedCommand:
    intended = gate.intended(command)
    positions = {robot.name: gate.view(robot.name).q for robot in cell.robots}
    reason = verdict.reasons[-1] if verdict.reasons else None
    points = None
    if reason is not None and reason.pair is not None and intended is not None:
        points = gate.witness(command.robot, reason.pair, intended.end)
    return ExplainedCommand(time, command, verdict, intended, positions, points)


# --- text ---------------------------------------------------------------------------------------------


def explanation(found: ExplainedCommand, cell: Cell) -> str:
    """Return the lines that explain a command: verdict, reasons and meaning, increments, clearance."""
    v, robot = found.verdict, cell.robot(found.command.robot)
    lines = [f"{v.robot}, tick {found.tick} ({found.time:.3f} s), seq {v.seq}: {v.outcome.value}"]
    if v.outcome is Outcome.LIMITED and v.beta < 1.0:
        lines[0] += (
            f", {100 * v.beta:.0f} % of the way from braking (0) to the increment within the bounds (1)"
        )
    for reason in v.reasons:
        lines.append(f"  {reason.text}")
        lines.append(f"    {MEANINGS[reason.cause]}")
    if not v.reasons:
        lines.append("  no check limited it")
    if len(found.command.dq) == robot.model.n:
        lines += _increment_lines(robot, found.command.dq, v.dq)
    if found.reason is not None and found.reason.pair is not None:
        lines += _clearance_lines(found)
    return "\n".join(map(printable, lines))


def _increment_lines(robot: Robot, commanded: Joints, played: Joints) -> list[str]:
    lines = ["  commanded → played this tick"]
    for joint, a, b in zip(robot.model.joints, commanded, played, strict=True):
        mark = "" if a == b else "   ←"
        lines.append(f"    {joint.name}: {_quantity(joint.kind, a)} → {_quantity(joint.kind, b)}{mark}")
    return lines


def _quantity(kind: str, value: float) -> str:
    factor, unit = (57.29577951308232, "°") if kind == "revolute" else (1000.0, " mm")
    return f"{factor * value:+.4f}{unit}"


def _clearance_lines(found: ExplainedCommand) -> list[str]:
    reason = found.reason
    assert reason is not None
    assert reason.pair is not None
    lines = []
    if reason.value is not None and reason.bound is not None:
        lines.append(f"  short by {1000 * (reason.bound - reason.value):.4f} mm")
    if found.points is not None:
        distance = sum((a - b) ** 2 for a, b in zip(*found.points, strict=True)) ** 0.5
        lines.append(f"  at the end of that stop: nearest points {1000 * distance:.1f} mm apart, at")
        for name, point in zip(reason.pair, found.points, strict=True):
            lines.append(f"    {name}: ({', '.join(f'{x:.3f}' for x in point)}) m")
        lines.append(
            "  the gate also considers other timings of other robots, so its lower bound may be smaller"
        )
    return lines
