"""``armgate recover``, ``replay``, ``explain``, ``report``, ``audit`` and ``lag``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, assert_never

import typer

if TYPE_CHECKING:
    from armgate.audit.lag import RobotLags
    from armgate.audit.recover import RecoveredFile
    from armgate.audit.replay import ReplayResult, Span
    from armgate.recording.verify import Chain

Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a recording, or one of its files.")]
_LISTED = 20
_PICTURES = 12


def replay(
    run: Run,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Replay with another configuration value; repeat to combine."
        ),
    ] = None,
) -> None:
    """Replay a recording through the gate and compare all outputs; with --set, list the verdicts that change.

    Exit status: 0 if all outputs agree and the hash chain is intact, 1 if not, 2 for wrong use.
    """
    from armgate.audit.recorded_cell import changed_cell, recorded_cell
    from armgate.audit.replay import replay_recording
    from armgate.recording import Recording
    from armgate.recording.verify import verify

    recording = Recording.open(run)
    chain = verify(recording)
    if settings:
        cell, differing = changed_cell(recording.header, settings), 0
        _print_changes(replay_recording(recording, cell, other_rules=True), settings)
    else:
        result = replay_recording(recording, recorded_cell(recording.header))
        differing = result.count
        _print_replay(result)
    _print_chain(chain)
    raise typer.Exit(1 if differing or chain.breaks else 0)


def explain(
    run: Run,
    tick: Annotated[
        int | None, typer.Option(min=0, help="Explain the commands for this tick of a robot.")
    ] = None,
    refused: Annotated[
        bool,
        typer.Option(
            "--refused",
            help="Explain refused commands; if consecutive ones have the same reason, only the first.",
        ),
    ] = False,
    robot: Annotated[str | None, typer.Option(help="Explain only the commands of this robot.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the pictures; default: the folder of the recording."),
    ] = None,
) -> None:
    """Explain limited and refused commands, in text and pictures."""
    from armgate.audit.errors import AuditError, UseError
    from armgate.audit.explain import at_tick, explanation, first_refusals, selected_commands
    from armgate.audit.explain_picture import draw_explanation
    from armgate.audit.recorded_cell import recorded_cell
    from armgate.recording import Recording

    if (tick is None) != refused:
        raise UseError("expected one of --tick N and --refused")
    recording = Recording.open(run)
    cell = recorded_cell(recording.header)
    if robot is not None and robot not in (names := [r.name for r in cell.robots]):
        raise UseError(f"--robot {robot}: the recording has {', '.join(names)}")
    folder = out or (run if run.is_dir() else run.parent)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = first_refusals(robot) if tick is None else at_tick(tick, robot)
    number = 0
    for number, found in enumerate(selected_commands(recording, cell, wanted), start=1):
        typer.echo(explanation(found, cell))
        file = folder / f"explain-{found.command.robot}-{found.tick}-{found.verdict.seq}.png"
        if number > _PICTURES:
            typer.echo(f"  (no picture: {_PICTURES} pictures were drawn already; use --tick)")
        elif draw_explanation(found, cell, file):
            typer.echo(f"  picture: {file}")
    if not number:
        whose = "" if robot is None else f" of {robot}"
        refusals, commands = f"no command{whose} was refused", f"there is no command{whose} for tick {tick}"
        raise AuditError(f"{run}: {refusals if tick is None else commands}")


def report(
    run: Run,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="File of the page; default: report.html in the folder of the recording."
        ),
    ] = None,
) -> None:
    """Write a report of a recording: one HTML page with tables and plots."""
    from armgate.audit.report import report_page
    from armgate.recording import Recording
    from armgate.recording.files import atomic_write

    _check_out(out)
    text = report_page(Recording.open(run))
    file = out or (run if run.is_dir() else run.parent) / "report.html"
    if out is None:
        with atomic_write(file) as stream:
            stream.write(text.encode(errors="replace"))
    else:
        file.write_text(text, encoding="utf-8", errors="replace")
    typer.echo(f"written: {file}")


def _check_out(file: Path | None) -> None:
    """Check that a file can be written to this place, before the work on a long recording.

    Raises:
        UseError: Its folder does not exist, or it is a folder itself.
    """
    from armgate.audit.errors import UseError
    from armgate.recording.files import output_problem

    if file is not None and (problem := output_problem(file)) is not None:
        raise UseError(f"--out {file}: {problem}")


def audit(
    run: Run,
    key: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Public key (Ed25519, PEM) with which the recording must be signed."
        ),
    ] = None,
) -> None:
    """Audit a recording: verify its hash chain and its signature.

    Exit status: 0 if both are valid, 1 if not, 2 for wrong use. A signature is required only with --key.
    """
    from armgate.audit.errors import AuditError
    from armgate.audit.signature import check_signature, public_key
    from armgate.recording import Recording
    from armgate.recording.verify import verify

    public = None if key is None else public_key(key)
    chain = verify(Recording.open(run))
    _print_chain(chain)
    if chain.breaks or not chain.present:
        raise typer.Exit(1)
    if public is None and not any(seal.signature for seal in chain.seals):
        return
    if chain.unsealed:
        raise AuditError(f"{chain.unsealed[0]}: not sealed, so it has no signature")
    keys = {check_signature(seal, public) for seal in chain.seals}
    typer.echo(f"signed with the key {', '.join(sorted(keys))}")


def recover(run: Run) -> None:
    """Recover a recording that is truncated or damaged: keep all readable messages."""
    from armgate.audit.recover import recover_recording

    for one in recover_recording(run):
        typer.echo(f"{one.file}: {_recovery(one)}")


def _print_chain(chain: "Chain") -> None:
    if not chain.present:
        typer.echo("no hash chain: written by an earlier armgate, or removed")
        return
    for found in chain.breaks[:_LISTED]:
        _print(f"hash chain broken: {found}")
    if len(chain.breaks) > _LISTED:
        typer.echo(f"  … and {len(chain.breaks) - _LISTED} more")
    if not chain.breaks:
        end = "not sealed" if chain.unsealed else f"sealed {chain.seals[-1].digest.hex()}"
        writers = ", ".join(sorted({seal.by[:40] for seal in chain.seals if seal.by}))
        by = f", written by {writers}" if writers else ""
        _print(f"hash chain intact: {chain.links} links in {_parts(chain)}, {end}{by}")


def _parts(chain: "Chain") -> str:
    """Return the range of the parts, and a note if it is unknown whether more parts followed."""
    first, last = chain.parts
    text = f"part {first}" if first == last else f"parts {first} to {last}"
    return (
        text if chain.last is not None else f"{text} (the recording does not show if another part followed)"
    )


def _recovery(one: "RecoveredFile") -> str:
    match one.action:
        case "none":
            return "complete, nothing to recover"
        case "removed":
            return _removed(one)
        case "recovered":
            return _recovered_messages(one)
        case _:
            assert_never(one.action)


def _removed(one: "RecoveredFile") -> str:
    if one.original is None:
        return "removed, it was empty"
    return f"removed, no message can be read; the damaged file is kept as {one.original.name}"


def _recovered_messages(one: "RecoveredFile") -> str:
    result = one.result
    text = f"recovered, {result.messages} messages"
    if result.lost:
        text += f"; {result.lost} more were lost by damage and are counted in a gap"
    if result.dropped:
        text += f"; {result.dropped} bytes at its end were not a complete record and were removed"
    return text if one.original is None else f"{text}; the damaged file is kept as {one.original.name}"


def _print(text: str) -> None:
    """Print one line, with control characters from the recording escaped."""
    from armgate.cell.terminal_text import printable

    typer.echo(printable(text))


def _print_replay(result: "ReplayResult") -> None:
    if result.differs_in:
        _print(f"this machine differs from that of the recording ({'; '.join(result.differs_in)}):")
        typer.echo(f"numbers are compared with a tolerance of {result.tolerance:g} rad or m, not bit for bit")
    how = "bit for bit" if result.tolerance is None else f"within {result.tolerance:g}"
    same = result.events - result.count
    typer.echo(f"{same} of {result.events} events ({result.verdicts} commands) have the same outputs, {how}")
    for time, event, differing in result.differing:
        _print(f"  {time:.3f} s, {type(event).__name__.lower()}: {'; '.join(differing[:3])}")
    if result.count > len(result.differing):
        typer.echo(f"  … and {result.count - len(result.differing)} more")


def _print_changes(result: "ReplayResult", settings: list[str]) -> None:
    from armgate.audit.replay import spans, tally

    typer.echo(f"{len(result.changes)} of {result.verdicts} verdicts would change with {' '.join(settings)}")
    typer.echo("(each command is decided at the recorded positions; the later motion would have differed)")
    for (robot, was, now), count in tally(result.changes).most_common():
        _print(f"  {robot}: {was} → {now}: {count}")
    for time, stop in result.stops[:_LISTED]:
        _print(f"  {time:.3f} s: {', '.join(stop.robots)} would be stopped: {stop.reason}")
    runs = spans(result.changes)
    for span in runs[:_LISTED]:
        _print(f"  {_span_text(span)}")
    if len(runs) > _LISTED:
        typer.echo(f"  … and {len(runs) - _LISTED} more")


def _span_text(span: "Span") -> str:
    robot, was, now = span.change
    first, last = span.first, span.last
    when, which = f"{first.time:.3f} s", f"seq {first.was.seq}"
    if span.count > 1:
        when, which = f"{when} to {last.time:.3f} s", f"{which} to {last.was.seq}"
    reason = f": {first.now.reasons[-1].text}" if first.now.reasons else ""
    return f"{when}, {robot} {which}: {was} → {now}{reason}"


def lag(
    run: Run,
    robot: Annotated[str | None, typer.Option(metavar="NAME", help="Measure only this robot.")] = None,
) -> None:
    """Measure the lag of each axis in a recording, and propose values for the configuration."""
    from armgate.audit.errors import AuditError, UseError
    from armgate.audit.lag import measure_lags
    from armgate.audit.recorded_cell import recorded_cell
    from armgate.events import Tick
    from armgate.recording import Recording

    recording = Recording.open(run, partial=True)
    cell = recorded_cell(recording.header)
    names = [one.name for one in cell.robots]
    if robot is not None and robot not in names:
        raise UseError(f"--robot {robot}: the recording has {', '.join(names)}")
    ticks = [step.event for _, step in recording.steps() if isinstance(step.event, Tick)]
    found = [measure_lags(cell, name, ticks) for name in names if robot in (None, name)]
    if not any(found):
        raise AuditError(
            f"{run}: no joint moves far enough; record a run that moves each by more than 1 deg or 2 mm"
        )
    too_small = [text for lags in found if lags is not None for text in _print_lags(lags)]
    if too_small:
        raise AuditError("; ".join(too_small))


def _print_lags(lags: "RobotLags") -> list[str]:
    """Print the measured lags of a robot and the values to declare; return texts on too small ones."""
    robot, ms = lags.robot, 1000.0
    typer.echo(f"{robot.name}: delay {lags.delay} ticks ({ms * lags.delay * robot.period:g} ms)")
    for name, tau in lags.lags.items():
        typer.echo(f"  {name}: lag {ms * tau:.2f} ms, error {lags.errors[name]:.2g} rad or m")
    if lags.still:
        typer.echo(f"  not moved: {', '.join(lags.still)}; record a run that moves them too")
    typer.echo(f"  lags differ by {ms * lags.difference:.2f} ms; declare in robots.{robot.name}:")
    typer.echo(f"    lag_window: {ms * (lags.delay + 1) * robot.period:g} ms")
    typer.echo(f"    lag_difference: {ms * lags.proposed:.2f} ms")
    typer.echo(f"    link: {{lag: {ms * lags.lag:.1f} ms}}")
    low = robot.lag_difference < lags.difference
    declared = f"{ms * robot.lag_difference:.2f} ms"
    text = f"{robot.name}: lag_difference is {declared}, less than the {ms * lags.difference:.2f} ms measured"
    return [text] if low else []
