"""Replay of a recording: its events are fed to a new gate, and the outputs are compared."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from armgate.audit.event_check import event_error
from armgate.audit.output_differences import TOLERANCE, differences
from armgate.audit.replay_gate import ReplayGate
from armgate.cell.cell import Cell
from armgate.cell.compilation import available
from armgate.cell.errors import install_hint
from armgate.events import Command, GateEvent, GateOutput, Stopped, Verdict
from armgate.recording import DamagedError, Header, Recording, Step, machine, software

_KEPT = 20
"""Number of differing events that are kept."""


@dataclass(frozen=True, slots=True)
class VerdictChange:
    """Verdict with another outcome or cause than the recorded one."""

    time: float
    was: Verdict
    now: Verdict


@dataclass
class ReplayResult:
    """Result of a replay.

    Attributes:
        events: Number of events.
        verdicts: Number of commands among them.
        differing: The first events whose outputs differ: daemon time, event, differences.
        count: Number of all events whose outputs differ.
        changes: Verdicts with another outcome or cause.
        tolerance: Tolerance of the comparison; None if it is bit for bit.
        differs_in: Differences between this machine and the recording one.
        stops: Stops that the gate raises in the replay only.
    """

    events: int = 0
    verdicts: int = 0
    count: int = 0
    differing: list[tuple[float, GateEvent, list[str]]] = field(default_factory=list)
    changes: list[VerdictChange] = field(default_factory=list)
    tolerance: float | None = None
    differs_in: list[str] = field(default_factory=list)
    stops: list[tuple[float, Stopped]] = field(default_factory=list)

    def compare(
        self, time: float, event: GateEvent, then: Sequence[GateOutput], now: Sequence[GateOutput]
    ) -> None:
        """Compare recorded and recomputed outputs of an event, and note the differences."""
        if differing := differences(then, now, self.tolerance):
            self.count += 1
            if len(self.differing) < _KEPT:
                self.differing.append((time, event, differing))


def machine_differences(header: Header) -> list[str]:
    """Return the differences between this machine and the recording one that can change the last bits."""
    if header.judge == "compiled" and not available():
        return [f"no compiled gate, recorded with a compiled gate; to install it, run {install_hint('fast')}"]
    pairs = [(header.machine, machine()), (header.software, software())]
    return [
        f"{key} {now.get(key, 'none')}, recorded with {then.get(key, 'none')}"
        for then, now in pairs
        for key in sorted(then.keys() | now.keys())
        if then.get(key) != now.get(key)
    ]


def gate_for(header: Header, cell: Cell) -> ReplayGate:
    """Return a gate of the recorded kind, numpy or compiled, if that is available."""
    return ReplayGate(cell, header.start, compiled=header.judge == "compiled" and available())


def checked_steps(recording: Recording, cell: Cell) -> Iterator[tuple[float, Step]]:
    """Yield the events of a recording with their outputs.

    Raises:
        RecordingError: The recording is damaged, has a gap, or holds an event that does not fit its cell.
    """
    for time, step in recording.steps():
        if (why := event_error(cell, step.event)) is not None:
            kind = type(step.event).__name__.lower()
            raise DamagedError(recording.path, f"the {kind} at {time:.3f} s does not fit its cell: {why}")
        yield time, step


def gate_outputs(
    recording: Recording,
    gate: ReplayGate,
    time: float,
    event: GateEvent,
    then: Sequence[GateOutput] | None = None,
) -> Sequence[GateOutput]:
    """Feed an event to a gate and return its outputs; if ``then`` is given, follow these recorded outputs.

    Raises:
        DamagedError: The gate cannot process the event.
    """
    try:
        return gate.step(event) if then is None else gate.step_following(event, then)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        kind = type(event).__name__.lower()
        text = f"the gate cannot process the {kind} at {time:.3f} s after the events recorded before it"
        raise DamagedError(recording.path, f"{text}: {error!r:.200}") from error


def replay_recording(recording: Recording, cell: Cell, *, other_rules: bool = False) -> ReplayResult:
    """Replay every event of a recording.

    Args:
        recording: The recording.
        cell: Its cell, or the cell with changed values.
        other_rules: True if values are changed; each command is then decided at the recorded positions.

    Raises:
        RecordingError: The recording is damaged or has a gap.
    """
    result = ReplayResult(differs_in=machine_differences(recording.header))
    result.tolerance = TOLERANCE if result.differs_in else None
    gate = gate_for(recording.header, cell)
    for time, step in checked_steps(recording, cell):
        event, then = step.event, step.outputs
        now = gate_outputs(recording, gate, time, event, then if other_rules else None)
        result.events += 1
        if not other_rules:
            result.compare(time, event, then, now)
        if isinstance(event, Command):
            result.verdicts += 1
            _note_change(result, time, then, now)
        result.stops += [(time, o) for o in now if isinstance(o, Stopped) and not _recorded(o, then)]
    return result


def _recorded(stop: Stopped, then: Sequence[GateOutput]) -> bool:
    """Return True if a stop is among recorded outputs, also with a reason in other words."""
    return any(not differences([one], [stop], TOLERANCE) for one in then)


def _note_change(
    result: ReplayResult, time: float, then: Sequence[GateOutput], now: Sequence[GateOutput]
) -> None:
    was = next((output for output in then if isinstance(output, Verdict)), None)
    is_ = next((output for output in now if isinstance(output, Verdict)), None)
    if was is not None and is_ is not None and outcome_and_cause(was) != outcome_and_cause(is_):
        result.changes.append(VerdictChange(time, was, is_))


def outcome_and_cause(verdict: Verdict) -> str:
    """Return outcome and last cause of a verdict, such as ``limited by acceleration``."""
    if not verdict.reasons:
        return verdict.outcome.value
    return f"{verdict.outcome.value} by {verdict.reasons[-1].cause.value}"


@dataclass(slots=True)
class Span:
    """Consecutive verdicts of one robot that change in the same way."""

    first: VerdictChange
    last: VerdictChange
    count: int = 1

    @property
    def change(self) -> tuple[str, str, str]:
        """Robot, recorded outcome and cause, recomputed outcome and cause."""
        return self.first.was.robot, outcome_and_cause(self.first.was), outcome_and_cause(self.first.now)


def spans(changes: Sequence[VerdictChange]) -> list[Span]:
    """Group consecutive changes of the same kind."""
    found: list[Span] = []
    newest: dict[str, Span] = {}
    for change in changes:
        span, new = newest.get(change.was.robot), Span(change, change)
        if span is not None and span.change == new.change and span.last.was.seq + 1 == change.was.seq:
            span.last, span.count = change, span.count + 1
        else:
            newest[change.was.robot] = new
            found.append(new)
    return found


def tally(changes: Sequence[VerdictChange]) -> Counter[tuple[str, str, str]]:
    """Count the changes by robot, recorded and recomputed outcome and cause."""
    return Counter(
        (change.was.robot, outcome_and_cause(change.was), outcome_and_cause(change.now)) for change in changes
    )
