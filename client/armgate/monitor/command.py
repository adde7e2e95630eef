"""``armgate monitor``: independent check of a running cell, or of a recording."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login

if TYPE_CHECKING:
    from armgate.monitor.findings import Summary

SILENCE = 1.0
"""Default of ``--silence``, s; repeats ``tolerances.SILENCE``, so that ``--help`` need not import it."""


def monitor(
    source: Annotated[
        str,
        typer.Argument(
            metavar="HOST:PORT|unix:PATH|RUN",
            help="Address or Unix socket of the daemon, or a recording: the folder of the run, "
            "or one of its files.",
        ),
    ],
    config: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Configuration of the cell; later files overlay earlier ones. Required for a daemon; "
            "by default a recording is checked against the configuration in it.",
            show_default=False,
        ),
    ] = None,
    *,
    silence: Annotated[
        float,
        typer.Option(min=0.05, metavar="S", help="Stop the cell if a robot sends no state for S seconds."),
    ] = SILENCE,
    json_: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write the summary as JSON.", show_default=False),
    ] = None,
    name: Annotated[str, typer.Option(help="Name of this client.")] = "monitor",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Check every state with independent kinematics and distances; stop the cell if a rule is violated.

    Exit status: 0 if no rule was violated, 1 if one was or the connection was lost, 2 for wrong use.
    """
    from armgate.monitor.errors import DescriptionError

    _check_json(json_)
    configs = tuple(config or ())
    if is_recording(source):
        from armgate.monitor.offline import check_recording

        if not Path(source).exists():
            raise DescriptionError(f"{source}: neither HOST:PORT, unix:PATH nor a recording")
        _, summary = check_recording(Path(source), configs, silence)
        _end(summary, json_)
        return
    if not configs:
        raise DescriptionError("no configuration given; give the configuration of the cell after the address")
    _watch(source, configs, silence, json_, name, login(token_file, ca, cert, key))


def _check_json(file: Path | None) -> None:
    """Check that the summary can be written to this place, before a run that may take hours.

    Raises:
        DescriptionError: Its folder does not exist, or it is a folder itself.
    """
    from armgate.monitor.errors import DescriptionError
    from armgate.recording.files import output_problem

    if file is not None and (problem := output_problem(file)) is not None:
        raise DescriptionError(f"--json {file}: {problem}")


def _watch(  # type: ignore[no-untyped-def]
    address: str, configs: tuple[Path, ...], silence: float, json_: Path | None, name: str, own
) -> None:
    from armgate.client import connect
    from armgate.monitor.live import LiveMonitor, end_requests
    from armgate.monitor.report import printable

    def echo(text: str) -> None:
        typer.echo(f"armgate: monitor: {printable(text)}")

    with connect(address, name=name, role="observer", **own) as cell, end_requests() as ended:
        live = LiveMonitor(cell, configs, silence, echo)
        try:
            live.run(ended)
        finally:
            _write(live.summary, json_)
    _end(live.summary, None)


def _end(summary: "Summary", json_: Path | None) -> None:
    from armgate.monitor.report import lines, printable

    _write(summary, json_)
    for line in lines(summary):
        typer.echo(f"armgate: monitor: {printable(line)}")
    raise typer.Exit(1 if summary.violations else 0)


def _write(summary: "Summary", json_: Path | None) -> None:
    import json

    from armgate.monitor.report import as_json

    if json_ is not None:
        json_.write_text(json.dumps(as_json(summary), indent=2) + "\n", encoding="utf-8")


def is_recording(source: str) -> bool:
    """Return True if a path is given, and not an address."""
    if source.startswith("unix:"):
        return False
    return Path(source).exists() or re.search(r":\d+$", source) is None
