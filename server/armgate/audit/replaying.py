"""Judges a recorded run again."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from armgate.audit.compare import TOLERANCE, differences
from armgate.audit.fitting import misfit
from armgate.cell.cell import Cell
from armgate.cell.errors import install_hint
from armgate.events import Command, GateEvent, GateOutput, Stopped, Verdict
from armgate.gate import GateBeside
from armgate.gate.clearance.compiled import available
from armgate.recording import DamagedError, Header, Recording, Step, machine, software

Progress = Callable[[int], None]

_SHOWN = 20
"""So many events that differ are kept."""


@dataclass(frozen=True, slots=True)
class Change:
    """A verdict that is another one now."""

    time: float
    was: Verdict
    now: Verdict


@dataclass
class Outcome:
    """What came of a replay.

    Attributes:
        events: How many events were judged.
        verdicts: How many of them were commands.
        differing: The first events whose outputs differ: daemon time, event, what differs.
        count: How many differ in all.
        changes: Verdicts whose outcome or reasons are others.
        tolerance: What numbers were compared with; None: to the last bit.
        foreign: In what this machine differs from the one that recorded.
        stops: Stops that the gate raises now and did not then.
    """

    events: int = 0
    verdicts: int = 0
    count: int = 0
    differing: list[tuple[float, GateEvent, list[str]]] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    tolerance: float | None = None
    foreign: list[str] = field(default_factory=list)
    stops: list[tuple[float, Stopped]] = field(default_factory=list)

    def compare(
        self, time: float, event: GateEvent, then: Sequence[GateOutput], now: Sequence[GateOutput]
    ) -> None:
        """Notes whether two answers to an event differ."""
        if differing := differences(then, now, self.tolerance):
            self.count += 1
            if len(self.differing) < _SHOWN:
                self.differing.append((time, event, differing))


def foreign(header: Header) -> list[str]:
    """In what this machine and its software differ from what recorded, as far as bits may depend on it."""
    if header.judge == "compiled" and not available():
        return [f"no compiled gate here, recorded with one; {install_hint('fast')}"]
    pairs = [(header.machine, machine()), (header.software, software())]
    return [
        f"{key} {now.get(key, 'none')}, recorded with {then.get(key, 'none')}"
        for then, now in pairs
        for key in sorted(then.keys() | now.keys())
        if then.get(key) != now.get(key)
    ]


def gate_for(header: Header, cell: Cell) -> GateBeside:
    """A gate of the form that judged then, as far as it is to be had here."""
    return GateBeside(cell, header.start, compiled=header.judge == "compiled" and available())


def fitting_steps(recording: Recording, cell: Cell) -> Iterator[tuple[float, Step]]:
    """Yield the events of a run with their outputs.

    Raises:
        RecordingError: The recording is damaged, has a gap, or holds an event that its cell cannot have.
    """
    for time, step in recording.steps():
        if (why := misfit(cell, step.event)) is not None:
            kind = type(step.event).__name__.lower()
            raise DamagedError(recording.path, f"the {kind} at {time:.3f} s is not one of its cell: {why}")
        yield time, step


def judged(
    recording: Recording,
    gate: GateBeside,
    time: float,
    event: GateEvent,
    then: Sequence[GateOutput] | None = None,
) -> Sequence[GateOutput]:
    """Let a gate judge an event, beside what was answered then if that is given.

    Raises:
        DamagedError: The gate cannot take it.
    """
    try:
        return gate.step(event) if then is None else gate.step_beside(event, then)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        kind = type(event).__name__.lower()
        text = f"the gate cannot take the {kind} at {time:.3f} s, after what was recorded before"
        raise DamagedError(recording.path, f"{text}: {error!r:.200}") from error


def replayed(
    recording: Recording, cell: Cell, *, otherwise: bool = False, progress: Progress | None = None
) -> Outcome:
    """Judges every event again.

    Args:
        recording: The run.
        cell: Its cell, or one under other rules.
        otherwise: Whether the rules are others: then each command is judged where the robots were.
        progress: Told after every thousand events how many were judged.

    Raises:
        RecordingError: The recording is damaged or has a gap.
    """
    out = Outcome(foreign=foreign(recording.header))
    out.tolerance = TOLERANCE if out.foreign else None
    gate = gate_for(recording.header, cell)
    for time, step in fitting_steps(recording, cell):
        event, then = step.event, step.outputs
        now = judged(recording, gate, time, event, then if otherwise else None)
        out.events += 1
        if not otherwise:
            out.compare(time, event, then, now)
        if isinstance(event, Command):
            out.verdicts += 1
            _note_change(out, time, then, now)
        out.stops += [(time, o) for o in now if isinstance(o, Stopped) and o not in then]
        if progress is not None and out.events % 1000 == 0:
            progress(out.events)
    return out


def _note_change(out: Outcome, time: float, then: Sequence[GateOutput], now: Sequence[GateOutput]) -> None:
    was = next((output for output in then if isinstance(output, Verdict)), None)
    is_ = next((output for output in now if isinstance(output, Verdict)), None)
    if was is not None and is_ is not None and kind(was) != kind(is_):
        out.changes.append(Change(time, was, is_))


def kind(verdict: Verdict) -> str:
    """Outcome and the last check that bound it, such as ``limited by acceleration``."""
    if not verdict.reasons:
        return verdict.outcome.value
    return f"{verdict.outcome.value} by {verdict.reasons[-1].cause.value}"


@dataclass(slots=True)
class Span:
    """Verdicts of one robot that follow each other and change in the same way."""

    first: Change
    last: Change
    count: int = 1

    @property
    def way(self) -> tuple[str, str, str]:
        """Robot, what the verdicts were and what they are."""
        return self.first.was.robot, kind(self.first.was), kind(self.first.now)


def spans(changes: Sequence[Change]) -> list[Span]:
    """The changes, those that follow each other taken together."""
    found: list[Span] = []
    newest: dict[str, Span] = {}
    for change in changes:
        span, new = newest.get(change.was.robot), Span(change, change)
        if span is not None and span.way == new.way and span.last.was.seq + 1 == change.was.seq:
            span.last, span.count = change, span.count + 1
        else:
            newest[change.was.robot] = new
            found.append(new)
    return found


def tally(changes: Sequence[Change]) -> Counter[tuple[str, str, str]]:
    """How many verdicts changed, by robot, what it was and what it is."""
    return Counter((change.was.robot, kind(change.was), kind(change.now)) for change in changes)
