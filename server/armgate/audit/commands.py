"""``armgate replay``, ``explain``, ``report``, ``audit``, ``recover`` and ``lag``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from armgate.audit.lagging import Lags
    from armgate.audit.recovering import Recovered
    from armgate.audit.replaying import Outcome, Span
    from armgate.recording.verify import Chain

Run = Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a recording, or one of its files.")]
_LISTED = 20
_PICTURES = 12


def replay(
    run: Run,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Judge under another configuration value."),
    ] = None,
) -> None:
    """Judge a recorded run again: the same answers to the last bit, or others under other rules."""
    from armgate.audit.build import changed_cell, recorded_cell
    from armgate.audit.replaying import replayed
    from armgate.recording import Recording
    from armgate.recording.verify import verify

    recording = Recording.open(run)
    chain = verify(recording)
    if settings:
        cell, differing = changed_cell(recording.header, settings), 0
        _tell_changes(replayed(recording, cell, otherwise=True), settings)
    else:
        outcome = replayed(recording, recorded_cell(recording.header))
        differing = outcome.count
        _tell_replay(outcome)
    _tell_chain(chain)
    raise typer.Exit(1 if differing or chain.breaks else 0)


def explain(
    run: Run,
    tick: Annotated[int | None, typer.Option(min=0, help="Explain the commands for this tick.")] = None,
    refused: Annotated[bool, typer.Option("--refused", help="Explain what was refused.")] = False,
    robot: Annotated[str | None, typer.Option(help="Only this robot's commands.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the pictures; the run's if none is named.")
    ] = None,
) -> None:
    """Say and draw why commands were limited or refused."""
    from armgate.audit.build import recorded_cell
    from armgate.audit.errors import AuditError, UseError
    from armgate.audit.explaining import at_tick, cases, first_refusals, words
    from armgate.audit.picture import draw
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
    for number, case in enumerate(cases(recording, cell, wanted), start=1):
        typer.echo(words(case, cell))
        file = folder / f"explain-{case.command.robot}-{case.tick}-{case.verdict.seq}.png"
        if number > _PICTURES:
            typer.echo(f"  (no picture: {_PICTURES} were drawn; name its --tick)")
        elif draw(case, cell, file):
            typer.echo(f"  picture: {file}")
    if not number:
        what = "nothing was refused" if tick is None else f"no command was for tick {tick}"
        raise AuditError(f"{run}: {what}{'' if robot is None else f' of {robot}'}")


def report(
    run: Run,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The page; report.html in the run's folder if none.")
    ] = None,
) -> None:
    """Write a run as one HTML page with plots."""
    from armgate.audit.reporting import page
    from armgate.recording import Recording
    from armgate.recording.files import atomic_write

    text = page(Recording.open(run))
    file = out or (run if run.is_dir() else run.parent) / "report.html"
    if out is None:
        with atomic_write(file) as stream:
            stream.write(text.encode(errors="replace"))
    else:
        file.write_text(text, encoding="utf-8", errors="replace")
    typer.echo(f"written: {file}")


def audit(
    run: Run,
    key: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Public key (Ed25519, PEM) that must have signed the recording."),
    ] = None,
) -> None:
    """Verify the hash chain of a recording, and its signature."""
    from armgate.audit.errors import AuditError
    from armgate.audit.signing import check_signature, public_key
    from armgate.recording import Recording
    from armgate.recording.verify import verify

    public = None if key is None else public_key(key)
    chain = verify(Recording.open(run))
    _tell_chain(chain)
    if chain.breaks or not chain.present:
        raise typer.Exit(1)
    if public is None and not any(seal.signature for seal in chain.seals):
        return
    if chain.unsealed:
        raise AuditError(f"{chain.unsealed[0]}: without a seal there is no signature")
    keys = {check_signature(seal, public) for seal in chain.seals}
    typer.echo(f"signed with the key {', '.join(sorted(keys))}")


def recover(run: Run) -> None:
    """Make a recording whole that breaks off or is damaged: keep all that can be read."""
    from armgate.audit.recovering import recovered

    for one in recovered(run):
        match one.what:
            case "whole":
                typer.echo(f"{one.file}: whole already")
            case "removed":
                typer.echo(f"{one.file}: removed, nothing had been written to it")
            case _:
                typer.echo(f"{one.file}: {_recovery(one)}")


def _tell_chain(chain: "Chain") -> None:
    if not chain.present:
        typer.echo("no hash chain: written by an earlier armgate, or taken out")
        return
    for found in chain.breaks[:_LISTED]:
        _say(f"hash chain broken: {found}")
    if len(chain.breaks) > _LISTED:
        typer.echo(f"  … and {len(chain.breaks) - _LISTED} more")
    if not chain.breaks:
        end = "not sealed" if chain.unsealed else f"sealed {chain.seals[-1].digest.hex()}"
        writers = ", ".join(sorted({seal.by[:40] for seal in chain.seals if seal.by}))
        by = f", written by {writers}" if writers else ""
        _say(f"hash chain intact: {chain.links} links in {_parts(chain)}, {end}{by}")


def _parts(chain: "Chain") -> str:
    """Return the range of the parts, and a note if it is not known if more of them followed."""
    first, last = chain.parts
    text = f"part {first}" if first == last else f"parts {first} to {last}"
    return text if chain.last is not None else f"{text} (does not state if another part followed)"


def _recovery(one: "Recovered") -> str:
    result = one.result
    text = f"recovered, {result.messages} messages"
    if result.lost:
        text += f"; {result.lost} more were lost to damage, which a gap marks"
    if result.dropped:
        text += f"; {result.dropped} bytes at its end were no whole record"
    return text if one.original is None else f"{text}; the damaged file is kept as {one.original.name}"


def _say(text: str) -> None:
    """Print one line, whatever the recording holds."""
    from armgate.cell.escaping import printable

    typer.echo(printable(text))


def _tell_replay(outcome: "Outcome") -> None:
    if outcome.foreign:
        _say(f"another kind of machine than the recording's ({'; '.join(outcome.foreign)}):")
        typer.echo(f"numbers are compared to {outcome.tolerance:g} rad or m, not bit for bit")
    how = "to the last bit" if outcome.tolerance is None else f"within {outcome.tolerance:g}"
    same = outcome.events - outcome.count
    typer.echo(f"{same} of {outcome.events} events ({outcome.verdicts} commands) answered the same {how}")
    for time, event, differing in outcome.differing:
        _say(f"  {time:.3f} s, {type(event).__name__.lower()}: {'; '.join(differing[:3])}")
    if outcome.count > len(outcome.differing):
        typer.echo(f"  … and {outcome.count - len(outcome.differing)} more")


def _tell_changes(outcome: "Outcome", settings: list[str]) -> None:
    from armgate.audit.replaying import spans, tally

    typer.echo(
        f"{len(outcome.changes)} of {outcome.verdicts} verdicts would be others with {' '.join(settings)}"
    )
    typer.echo("(each judged where the robots were then: they would have gone on differently)")
    for (robot, was, now), count in tally(outcome.changes).most_common():
        _say(f"  {robot}: {was} → {now}: {count}")
    for time, stop in outcome.stops[:_LISTED]:
        _say(f"  {time:.3f} s: {', '.join(stop.robots)} would be stopped: {stop.reason}")
    runs = spans(outcome.changes)
    for span in runs[:_LISTED]:
        _say(f"  {_span(span)}")
    if len(runs) > _LISTED:
        typer.echo(f"  … and {len(runs) - _LISTED} more such stretches")


def _span(span: "Span") -> str:
    robot, was, now = span.way
    first, last = span.first, span.last
    when, which = f"{first.time:.3f} s", f"seq {first.was.seq}"
    if span.count > 1:
        when, which = f"{when} to {last.time:.3f} s", f"{which} to {last.was.seq}"
    reason = f": {first.now.reasons[-1].text}" if first.now.reasons else ""
    return f"{when}, {robot} {which}: {was} → {now}{reason}"


def lag(
    run: Run,
    robot: Annotated[str | None, typer.Option(metavar="NAME", help="Only this robot.")] = None,
) -> None:
    """Measure how each axis lags in a recorded run, and propose values for the configuration."""
    from armgate.audit.build import recorded_cell
    from armgate.audit.errors import AuditError, UseError
    from armgate.audit.lagging import measured_lags
    from armgate.events import Tick
    from armgate.recording import Recording

    recording = Recording.open(run, partial=True)
    cell = recorded_cell(recording.header)
    names = [one.name for one in cell.robots]
    if robot is not None and robot not in names:
        raise UseError(f"--robot {robot}: the recording has {', '.join(names)}")
    ticks = [step.event for _, step in recording.steps() if isinstance(step.event, Tick)]
    found = [measured_lags(cell, name, ticks) for name in names if robot in (None, name)]
    if not any(found):
        raise AuditError(f"{run}: no joint moves far enough; move each by more than 1 deg or 2 mm")
    small = [text for lags in found if lags is not None for text in _tell_lags(lags)]
    if small:
        raise AuditError("; ".join(small))


def _tell_lags(lags: "Lags") -> list[str]:
    """Print what was measured of a robot and what to declare; return what is declared too small."""
    robot, ms = lags.robot, 1000.0
    typer.echo(f"{robot.name}: delay {lags.delay} ticks ({ms * lags.delay * robot.period:g} ms)")
    for name, tau in lags.lags.items():
        typer.echo(f"  {name}: lag {ms * tau:.2f} ms, off by {lags.errors[name]:.2g} rad or m")
    if lags.still:
        typer.echo(f"  not moved: {', '.join(lags.still)}; move them too")
    typer.echo(f"  lags differ by {ms * lags.difference:.2f} ms; declare in robots.{robot.name}:")
    typer.echo(f"    lag_window: {ms * (lags.delay + 1) * robot.period:g} ms")
    typer.echo(f"    lag_difference: {ms * lags.proposed:.2f} ms")
    typer.echo(f"    link: {{lag: {ms * lags.lag:.1f} ms}}")
    low = robot.lag_difference < lags.difference
    declared = f"{ms * robot.lag_difference:.2f} ms"
    text = f"{robot.name}: lag_difference is {declared}, less than the {ms * lags.difference:.2f} ms measured"
    return [text] if low else []
